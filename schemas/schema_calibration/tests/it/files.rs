//! Files as their own programs write them, against the projections of other programs.
//!
//! The pixels were made with OpenCV 4 in Python (`cv2.projectPoints`, `cv2.fisheye.projectPoints`),
//! with numpy for the formulas of double spheres and f-theta polynomials (`numpy.polynomial`, whose
//! `polyroots` inverts one), and for Mei's model with `cv2.projectPoints` of the point on the sphere.
//! All three count from the middle of the first pixel.

use schema_calibration::{Camera, Format, read};

/// Points in the camera's optical axes that every oracle was asked for.
const POINTS: [[f64; 3]; 3] = [[0.3, -0.2, 1.0], [-0.5, 0.4, 1.0], [0.1, 0.05, 2.0]];

/// Whether the camera shows the points where the oracle does.
fn shows(camera: &Camera, wanted: [[f64; 2]; 3]) {
    for (point, [x, y]) in POINTS.into_iter().zip(wanted) {
        let [px, py] = camera.lens.project(point).expect("it is in front");
        let off = (px - 0.5 - x).abs().max((py - 0.5 - y).abs());
        assert!(off < 1e-9, "{point:?}: {px} {py} {off}");
    }
}

fn one(text: &str, format: Format) -> Camera {
    let (found, cameras) = read(text, None, None).expect("it is a file");
    assert_eq!(found, format);
    assert_eq!(cameras.len(), 1);
    cameras.into_iter().next().expect("one")
}

/// Why a file is refused.
fn refused(text: &str) -> String {
    read(text, None, None).unwrap_err().of_file("f")
}

/// Written by `cv2.FileStorage`.
const PINHOLE: &str = "%YAML:1.0
---
image_width: 752
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 458.654, 0., 367.21499999999997, 0., 457.29599999999999,
       248.375, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.28340810999999999, 0.073959070000000002,
       0.00019358999999999999, 1.7618711400000001e-05, 0.0123 ]
avg_reprojection_error: 0.20999999999999999
";

/// Written by `cv2.FileStorage`, with the key of OpenCV's own program of calibration.
const FISHEYE: &str = "%YAML:1.0
---
image_width: 848
image_height: 800
fisheye_model: 1
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 285., 0., 421.5, 0., 286.5, 398.25, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 4
   cols: 1
   dt: d
   data: [ -0.0132, 0.020400000000000001, -0.011299999999999999,
       0.0020999999999999999 ]
";

const BY_FISHEYE: [[f64; 2]; 3] = [
    [503.45234651948886, 343.3275502272899],
    [295.0679695940979, 499.92796971590445],
    [435.7346008583928, 405.40475990513954],
];
const BY_RADTAN: [[f64; 2]; 3] = [
    [499.9055685393346, 160.1887446901026],
    [161.6559088165268, 412.3743104182122],
    [390.12769384397535, 259.7976906002567],
];
const BY_OMNI: [[f64; 2]; 3] = [
    [458.96323642867526, 373.1478539801142],
    [363.0977844966822, 445.2296621989252],
    [427.971252381893, 401.50288663655203],
];

#[test]
fn files_of_opencv_show_points_where_opencv_does() {
    let pinhole = one(PINHOLE, Format::OpenCv);
    assert_eq!(pinhole.size_px, [752, 480]);
    shows(
        &pinhole,
        [
            [499.90928681520677, 160.18627317899507],
            [161.46150182867268, 412.52937552248295],
            [390.12769385258355, 259.79769060454805],
        ],
    );
    shows(&one(FISHEYE, Format::OpenCv), BY_FISHEYE);
}

#[test]
fn four_coefficients_of_opencv_are_not_guessed() {
    let unsaid = FISHEYE.replace("fisheye_model: 1\n", "");
    assert_eq!(
        refused(&unsaid),
        "f:10: distortion_coefficients has four numbers, which are k1, k2, p1, p2 of cv2.calibrateCamera or k1 to k4 of cv2.fisheye; write fisheye_model: 0 or fisheye_model: 1 into the file"
    );
}

/// The layout of Kalibr's results; the first camera is that of the EuRoC data set.
const CHAIN: &str = "cam0:
  camera_model: pinhole
  distortion_coeffs: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
  distortion_model: radtan
  intrinsics: [458.654, 457.296, 367.215, 248.375]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.0, 0.0, -1.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [1.0, 0.0, 0.0, 0.02]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.0132, 0.0204, -0.0113, 0.0021]
  distortion_model: equidistant
  intrinsics: [285.0, 286.5, 421.5, 398.25]
  resolution: [848, 800]
cam2:
  camera_model: omni
  distortion_coeffs: [-0.1, 0.02, 0.001, -0.0005]
  distortion_model: radtan
  intrinsics: [1.2, 285.0, 286.5, 421.5, 398.25]
  resolution: [848, 800]
cam3:
  camera_model: ds
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [-0.2, 0.59, 285.0, 286.5, 421.5, 398.25]
  resolution: [848, 800]
";

#[test]
fn every_camera_of_kalibr_s_chain_is_read() {
    let (format, cameras) = read(CHAIN, None, None).unwrap();
    assert_eq!((format, cameras.len()), (Format::Kalibr, 4));
    assert_eq!(cameras[1].name, "cam1");
    shows(&cameras[0], BY_RADTAN);
    shows(&cameras[1], BY_FISHEYE);
    shows(&cameras[2], BY_OMNI);
    shows(
        &cameras[3],
        [
            [524.0443218215587, 329.5273141476572],
            [263.1835033930879, 525.5697930607166],
            [439.29383576583234, 407.19374376651047],
        ],
    );
}

/// cam1 looks to the right of cam0, and 0.02 m to its right and 0.11 m ahead: its x axis is cam0's −z.
#[test]
fn the_second_camera_of_a_chain_stands_where_the_transform_says() {
    let (_, cameras) = read(CHAIN, None, None).unwrap();
    let pose = cameras[1].carrier_from_sensor.unwrap();
    // Of x' = −z − 0.11 and z' = x + 0.02 the origin is at x = −0.02, z = −0.11: behind, to the left.
    let place = pose.translation.vector;
    assert!((place - nalgebra::Vector3::new(-0.11, 0.02, 0.0)).norm() < 1e-12);
    let ahead = pose * nalgebra::Vector3::x();
    assert!((ahead - -nalgebra::Vector3::y()).norm() < 1e-12, "{ahead}");
    assert_eq!(cameras[2].carrier_from_sensor, None);
}

#[test]
fn what_kalibr_cannot_mean_is_refused_with_its_line() {
    let of = |from: &str, to: &str| refused(&CHAIN.replacen(from, to, 1));
    assert_eq!(
        of("radtan", "fov"),
        "f:4: cam0.distortion_model is \"fov\", but must be none, radtan or equidistant with pinhole, none or radtan with omni, none with ds"
    );
    assert_eq!(
        of("camera_model: pinhole", "camera_model: eucm"),
        "f:2: cam0.camera_model is \"eucm\", but must be pinhole, omni or ds"
    );
    assert_eq!(
        of("[458.654, 457.296, 367.215, 248.375]", "[458.654, 457.296]"),
        "f:5: cam0.intrinsics has 2 numbers, but must have 4: fu, fv, pu, pv"
    );
    assert_eq!(
        of("458.654", "x458"),
        "f:5: cam0.intrinsics[0] is \"x458\", but must be a number"
    );
    assert_eq!(
        of("458.654", "-458"),
        "f:2: it describes no lens: focal_px is [-458, 457.296], but both must be greater than 0"
    );
    assert_eq!(
        of("[0.0, 1.0, 0.0, 0.0]", "[0.0, 2.0, 0.0, 0.0]"),
        "f:10: the rotation in cam1.T_cn_cnm1 is none"
    );
}

/// The layout of `camera_calibration_parsers`.
const ROS: &str = "image_width: 752
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [458.654, 0, 367.215, 0, 457.296, 248.375, 0, 0, 1]
distortion_model: rational_polynomial
distortion_coefficients:
  rows: 1
  cols: 8
  data: [0.4, -0.05, 0.001, -0.002, 0.003, 0.6, 0.02, -0.004]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [458.654, 0, 367.215, 0, 0, 457.296, 248.375, 0, 0, 0, 1, 0]
";

#[test]
fn files_of_ros_show_points_where_opencv_does() {
    let camera = one(ROS, Format::Ros);
    assert_eq!(camera.name, "narrow_stereo");
    shows(
        &camera,
        [
            [501.0051725162739, 159.42582280967792],
            [153.99644014700928, 418.3323086463629],
            [390.1270717543312, 259.79997451560814],
        ],
    );
    let fisheye = ROS
        .replace("rational_polynomial", "equidistant")
        .replace(
            "[0.4, -0.05, 0.001, -0.002, 0.003, 0.6, 0.02, -0.004]",
            "[-0.0132, 0.0204, -0.0113, 0.0021]",
        )
        .replace(
            "[458.654, 0, 367.215, 0, 457.296, 248.375, 0, 0, 1]",
            "[285, 0, 421.5, 0, 286.5, 398.25, 0, 0, 1]",
        );
    shows(&one(&fisheye, Format::Ros), BY_FISHEYE);
    assert_eq!(
        refused(&ROS.replace("rational_polynomial", "thin_prism")),
        "f:8: distortion_model is \"thin_prism\", but must be plumb_bob, rational_polynomial or equidistant"
    );
    assert_eq!(
        refused(&ROS.replace(", 0.6, 0.02, -0.004", "")),
        "f:10: distortion_coefficients has 5 numbers, but must have 8, 12, 14"
    );
}

/// The layout of KITTI-360's `image_02.yaml`.
const KITTI360: &str = "%YAML:1.0
---
model_type: MEI
camera_name: image_02
image_width: 848
image_height: 800
mirror_parameters:
   xi: 1.2
distortion_parameters:
   k1: -0.1
   k2: 0.02
   p1: 0.001
   p2: -0.0005
projection_parameters:
   gamma1: 285.0
   gamma2: 286.5
   u0: 421.5
   v0: 398.25
";

#[test]
fn kitti_360_s_fisheyes_are_mei_s() {
    let camera = one(KITTI360, Format::Kitti360);
    assert_eq!(camera.name, "image_02");
    shows(&camera, BY_OMNI);
    assert_eq!(
        refused(&KITTI360.replace("MEI", "KANNALA_BRANDT")),
        "f:3: model_type is \"KANNALA_BRANDT\", but must be MEI"
    );
    assert_eq!(
        refused(&KITTI360.replace("   u0: 421.5\n", "")),
        "f:15: projection_parameters has no u0"
    );
}

/// The layout of KITTI's `calib.txt`; the baseline of camera 2 is 0.06 m to the left.
const KITTI: &str = "P0: 7.0e+02 0 6.0e+02 0 0 7.0e+02 1.8e+02 0 0 0 1 0
P2: 7.0e+02 0 6.0e+02 4.2e+01 0 7.0e+02 1.8e+02 0 0 0 1 0
R0_rect: 1 0 0 0 1 0 0 0 1
";

#[test]
fn kitti_s_projections_are_pinholes_side_by_side() {
    assert_eq!(
        refused(KITTI),
        "f:1: files of kitti do not tell how large the images are; add --size, e.g. --size 1242x375"
    );
    let (format, cameras) = read(KITTI, None, Some([1242, 375])).unwrap();
    assert_eq!((format, cameras.len()), (Format::Kitti, 2));
    let place = cameras[1].carrier_from_sensor.unwrap().translation.vector;
    assert!(
        (place - nalgebra::Vector3::new(0.0, 0.06, 0.0)).norm() < 1e-12,
        "{place}"
    );
    assert_eq!(
        cameras[1].lens.project([0.0, 0.0, 1.0]),
        Some([600.5, 180.5])
    );
    let bad = read(&KITTI.replace("1.8e+02", "1.8f"), None, Some([9, 9])).unwrap_err();
    assert_eq!(bad.line, Some(1));
}

/// Two sensors in nuScenes' layout; a lidar has no matrix.
const NUSCENES: &str = "[
{
\"token\": \"f4d2a6c281f34a7eb8bb033d82321f79\",
\"sensor_token\": \"47fcd48f71d75e0da5c8c1704a9bfe0a\",
\"translation\": [3.412, 0.0, 0.5],
\"rotation\": [0.9999984, 0.0, 0.0, 0.0017],
\"camera_intrinsic\": []
},
{
\"token\": \"1d31c729b073425e8e0202c5c6e66ee1\",
\"sensor_token\": \"725903f5b62f56118f4094b46a4470d8\",
\"translation\": [1.7, 0.016, 1.51],
\"rotation\": [0.5, -0.5, 0.5, -0.5],
\"camera_intrinsic\": [[1266.4, 0.0, 816.3], [0.0, 1266.4, 491.5], [0.0, 0.0, 1.0]]
}
]";

#[test]
fn nuscenes_camera_looks_where_its_quaternion_says() {
    let (format, cameras) = read(NUSCENES, None, Some([1600, 900])).unwrap();
    assert_eq!((format, cameras.len()), (Format::NuScenes, 1));
    let pose = cameras[0].carrier_from_sensor.unwrap();
    // The quaternion (0.5, −0.5, 0.5, −0.5) turns optical axes to a vehicle's that looks ahead.
    assert!(pose.rotation.angle() < 1e-12, "{pose}");
    assert_eq!(pose.translation.vector.as_slice(), [1.7, 0.016, 1.51]);
    assert_eq!(cameras[0].lens.plane().centre_px, [816.8, 492.0]);
}

/// The layout of NCore's parameters.
fn ncore(reference: &str) -> String {
    format!(
        "{{\"camera_model_type\": \"ftheta\", \"camera_model_parameters\": {{
\"resolution\": [1920, 1080], \"shutter_type\": \"ROLLING_TOP_TO_BOTTOM\",
\"principal_point\": [959.5, 543.25], \"reference_poly\": \"{reference}\",
\"pixeldist_to_angle_poly\": [0.0, 0.00106, -2e-8, 5e-11, -1e-14, 0.0],
\"angle_to_pixeldist_poly\": [0.0, 935.25, 3.5, -28.5, 1.25, 0.5],
\"max_angle\": 1.1, \"linear_cde\": [1.0004, -0.0002, 0.0003]}}}}"
    )
}

#[test]
fn ncore_s_reference_polynomial_is_the_one_that_counts() {
    let forward = one(&ncore("ANGLE_TO_PIXELDIST"), Format::NCore);
    shows(
        &forward,
        [
            [1228.3114291071568, 364.21850748663473],
            [546.4319758389541, 873.3956173758579],
            [1006.233230288151, 566.6236230262541],
        ],
    );
    assert_eq!(forward.max_angle_rad, Some(1.1));
    assert_eq!(forward.lens.project([1.0, 0.0, 0.4]), None);
    let backward = one(&ncore("PIXELDIST_TO_ANGLE"), Format::NCore);
    shows(
        &backward,
        [
            [1231.6718838106847, 361.9804061414113],
            [540.5408055434156, 878.10414948322],
            [1006.6757164724155, 566.844932471408],
        ],
    );
    assert_eq!(
        refused(&ncore("BOTH")),
        "f:3: camera_model_parameters.reference_poly is \"BOTH\", but must be PIXELDIST_TO_ANGLE or ANGLE_TO_PIXELDIST"
    );
}

#[test]
fn a_file_of_nothing_known_is_told_which_formats_there_are() {
    assert_eq!(
        refused("a: 1\n"),
        "f: this is no calibration of a known format; name the format with --format, one of kalibr, opencv, ros, nuscenes, kitti, kitti360, ncore"
    );
    assert_eq!(refused(""), "f: the file is empty");
}
