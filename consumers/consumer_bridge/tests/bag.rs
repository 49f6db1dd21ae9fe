//! A node of ROS 2 gets the same bytes whether the bridge sends a frame or a bag is played.

use std::collections::BTreeMap;

use consumer_bridge::ros2::frame_messages;
use consumer_forms::ros2::cdr::Writer;
use consumer_forms::ros2::types;
use consumer_sets::formats::rosbag::frames;
use consumer_truth::ticks::TickFrame;
use schema_frames::{FrameHeader, Modality};
use schema_types::Pose;

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
        let sent = frame_messages(&frame.topic, &frame.header, &frame.payload);
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
    let sent = frame_messages(&frame.topic, &frame.header, &frame.payload);
    let sent = sent
        .into_iter()
        .find(|(kind, _)| *kind == types::CAMERA_INFO);
    let (_, sent) = sent.expect("a calibration");
    assert_eq!(bag[&info], sent);
    assert!(sent.windows(5).any(|bytes| bytes == b"carla"));
}
