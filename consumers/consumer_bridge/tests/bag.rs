//! A node of ROS 2 gets the same bytes whether the bridge sends a frame or a bag is played.

use std::collections::BTreeMap;

use consumer_bridge::ros2::frame_messages;
use consumer_forms::foxglove::frames::{TopicName, calibration};
use consumer_forms::ros2::cdr::{Reader, Writer};
use consumer_forms::ros2::types;
use consumer_sets::formats::rosbag::frames;
use consumer_truth::ticks::TickFrame;
use schema_frames::{Calibration, FrameHeader, Modality};
use schema_types::Pose;
use schema_types::lens::{Lens, LensModel, Plane};

/// A frame of random bytes: two rows of five, or a list of ten elements.
fn frame(modality: Modality) -> TickFrame {
    let mut random = fastrand::Rng::with_seed(7);
    let mut header = FrameHeader::new(modality);
    match modality {
        Modality::Imu | Modality::Gnss => header.set_list(1),
        _ if modality.is_image() => header.set_image(5, 2),
        _ => header.set_list(10),
    }
    header.sim_nanos = 12_345_678_901;
    header.intrinsics_px = [4.0, 4.5, 2.5, 1.0];
    header.world_from_sensor = Pose::from_xyz_yaw(3.0, -2.0, 1.0, 0.7);
    let mut payload = vec![0; header.payload_bytes as usize];
    random.fill(&mut payload);
    TickFrame {
        topic: format!("ego/sensor/{}", modality.name()).into(),
        modality,
        header,
        payload,
    }
}

/// Messages by the full name of their type.
fn of_bag(frame: &TickFrame) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut keep = |_: &str, kind: &types::Type, message: &Writer| {
        found.insert(kind.full_name(), message.bytes().to_vec());
        Ok(())
    };
    let mut words = Default::default();
    frames::messages(&mut Writer::default(), &mut words, "ego", frame, &mut keep)
        .expect("a small frame");
    found
}

#[test]
fn bridge_and_bag_write_the_same_bytes_of_every_modality_that_both_have() {
    let mut both = Vec::new();
    for modality in Modality::ALL.iter().copied() {
        let frame = frame(modality);
        let sent = frame_messages(&frame.topic, &frame.header, None, &frame.payload);
        if sent.is_empty() {
            continue;
        }
        let bag = of_bag(&frame);
        for (kind, message) in sent {
            // Bags hold whole images only.
            if kind != types::COMPRESSED_IMAGE {
                assert_eq!(bag.get(&kind.full_name()), Some(&message), "{modality:?}");
                both.push((modality, kind.name));
            }
        }
    }
    let images = ["Rgb", "Depth", "Semantic", "Instance", "Flow"];
    let lists = ["Lidar", "SemanticLidar", "LidarReturns", "Radar"];
    for name in images {
        for kind in ["Image", "CameraInfo"] {
            assert!(
                both.iter()
                    .any(|(of, it)| format!("{of:?}") == name && *it == kind),
                "{name} as {kind}"
            );
        }
    }
    for name in lists {
        assert!(
            both.iter()
                .any(|(of, it)| format!("{of:?}") == name && *it == "PointCloud2"),
            "{name}"
        );
    }
    assert!(both.contains(&(Modality::Imu, "Imu")));
    assert!(both.contains(&(Modality::Gnss, "NavSatFix")));
}

#[test]
fn the_lens_of_a_camera_is_in_both() {
    let mut frame = frame(Modality::Rgb);
    frame.header.lens = [0.1, 0.2, 0.3, 0.4];
    assert!(frame.header.distortion().is_some());
    let bag = of_bag(&frame);
    let info = types::CAMERA_INFO.full_name();
    let sent = frame_messages(&frame.topic, &frame.header, None, &frame.payload);
    let sent = sent
        .into_iter()
        .find(|(kind, _)| *kind == types::CAMERA_INFO);
    let (_, sent) = sent.expect("a calibration");
    assert_eq!(bag[&info], sent);
    assert!(sent.windows(5).any(|bytes| bytes == b"carla"));
}

/// A frame through a lens of this model, and what `world/info` says of the lens.
fn through(model: LensModel) -> (TickFrame, Calibration) {
    let plane = Plane {
        focal_px: [1.5, 1.25],
        shear_px: [0.0; 2],
        centre_px: [2.25, 0.75],
    };
    let number = model.number();
    let lens = Lens::new(model, plane, None).unwrap();
    let mut frame = frame(Modality::Rgb);
    let size_px = [frame.header.width, frame.header.height];
    let calibration = Calibration::of_lens(lens, size_px);
    frame.header.optics = u32::from(number) | FrameHeader::DEPTH_ALONG_RAY;
    frame.header.intrinsics_px = [0.0; 4];
    frame.header.lens = [f32::NAN; 4];
    frame.header.calibration_crc = calibration.crc();
    (frame, calibration)
}

/// Model, coefficients and K of the `CameraInfo` of a frame.
fn camera_info(frame: &TickFrame, lens: Option<&Calibration>) -> (String, Vec<f64>, [f64; 9]) {
    let sent = frame_messages(&frame.topic, &frame.header, lens, &frame.payload);
    let info = sent.iter().find(|(kind, _)| *kind == types::CAMERA_INFO);
    let (_, bytes) = info.expect("a calibration");
    let mut reader = Reader::new(bytes).unwrap();
    let _stamp = (reader.u32().unwrap(), reader.u32().unwrap());
    let _frame_id = reader.text().unwrap();
    let _size = (reader.u32().unwrap(), reader.u32().unwrap());
    let model = reader.text().unwrap();
    let n = reader.u32().unwrap();
    let d = (0..n).map(|_| reader.f64().unwrap()).collect();
    (model, d, reader.f64s().unwrap())
}

#[test]
fn a_calibrated_lens_is_said_in_the_words_of_ros_2() {
    let k = [1.5, 0.0, 1.75, 0.0, 1.25, 0.25, 0.0, 0.0, 1.0];
    let four = [-0.01, 0.02, -0.003, 0.0005];
    let (frame, lens) = through(LensModel::KannalaBrandt { coefficients: four });
    let said = camera_info(&frame, Some(&lens));
    assert_eq!(said, ("equidistant".into(), four.to_vec(), k));
    let (frame, lens) = through(LensModel::OpenCv {
        coefficients: vec![-0.3, 0.1, 1e-3, 2e-3],
    });
    let said = camera_info(&frame, Some(&lens));
    let five = vec![-0.3, 0.1, 1e-3, 2e-3, 0.0];
    assert_eq!(said, ("plumb_bob".into(), five, k));
    let eight = vec![-0.3, 0.1, 1e-3, 2e-3, 0.01, 0.2, 0.02, -0.001];
    let (frame, lens) = through(LensModel::OpenCv {
        coefficients: eight.clone(),
    });
    let said = camera_info(&frame, Some(&lens));
    assert_eq!(said, ("rational_polynomial".into(), eight, k));
}

#[test]
fn a_lens_without_words_or_without_numbers_is_not_calibrated() {
    let none = (String::new(), Vec::new(), [0.0; 9]);
    let (frame, lens) = through(LensModel::Stereographic {});
    assert_eq!(camera_info(&frame, Some(&lens)), none);
    let (frame, lens) = through(LensModel::Equidistant {});
    assert_eq!(camera_info(&frame, None), none);
    assert_eq!(camera_info(&frame, Some(&lens)).0, "equidistant");
    let mut of_another = frame;
    of_another.header.calibration_crc ^= 1;
    assert_eq!(camera_info(&of_another, Some(&lens)), none);
}

#[test]
fn foxglove_gets_a_pinhole_of_a_pinhole_alone() {
    let pinhole = frame(Modality::Rgb);
    let name = TopicName::new(&pinhole.topic).unwrap();
    assert!(calibration(&name, &pinhole.header).is_some());
    let (fisheye, _) = through(LensModel::Equidistant {});
    assert!(calibration(&name, &fisheye.header).is_none());
}
