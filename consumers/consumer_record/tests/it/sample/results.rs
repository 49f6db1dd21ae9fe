//! A program that publishes results of every type. Each answers a frame of a camera, except tracks,
//! which answer the boxes.

#![allow(dead_code, reason = "every test uses its part of it")]

use schema_bus::{Bus, Frame, ResultLoan, ResultPublisher, ResultReader, ResultTopic};
use schema_frames::{
    About, Box2d, Box3d, BytesSchema, ElementType, Keypoint, KeypointSet, MaskRecord, Odometry,
    PathPoint, PixelFormat, PoseEstimate, ResultHeader, ResultType, Scalar, Space, Track,
    VehicleControl, VehicleControlRecord,
};
use schema_types::Pose;

/// `FileDescriptorSet` of `message user.Detection { string label = 1; double score = 2; }`.
pub const DESCRIPTOR: &str = "Ck8KFHVzZXIvZGV0ZWN0aW9uLnByb3RvEgR1c2VyIikKCURldGVjdGlvbhINCgVsYWJlbBgBIAEoCRINCgVzY29yZRgCIAEoAWIGcHJvdG8z";
/// Size of pictures and masks.
pub const SIZE_PX: [u32; 2] = [8, 6];

/// Topic of a type.
pub fn topic(kind: ResultType) -> String {
    format!("user/{}", kind.name())
}

/// Description of a type's topic.
pub fn about(kind: ResultType) -> About {
    let mut about = About::default();
    match kind {
        ResultType::Boxes2d => about.classes = vec!["person".into(), "car".into()],
        ResultType::Keypoints => about.bones = vec![[0, 1], [1, 2], [0, 9]],
        ResultType::Bytes => {
            about.schema = Some(BytesSchema {
                name: "user.Detection".into(),
                message_encoding: "protobuf".into(),
                schema_encoding: "protobuf".into(),
                base64: DESCRIPTOR.into(),
                ..BytesSchema::default()
            });
        }
        _ => {}
    }
    about
}

fn pose(tick: u64) -> Pose {
    Pose::from_xyz_yaw(tick as f64, 2.0, 0.5, 0.1)
}

pub fn box2d(tick: u64, class: u32) -> Box2d {
    Box2d {
        min_px: [1.0 + (tick % 3) as f32, 1.0],
        max_px: [5.0, 4.5],
        score: 0.75,
        class,
        id: 0,
        reserved: 0,
    }
}

fn box3d(tick: u64) -> Box3d {
    Box3d {
        pose: pose(tick),
        half_m: [2.0, 1.0, 0.8],
        velocity_mps: [3.0, 0.0, 0.0],
        score: 0.5,
        class: 14,
        id: 3,
        n_points: 10,
        reserved: [0; 2],
    }
}

fn track(tick: u64, flags: u32) -> Track {
    Track {
        id: 5,
        class: 14,
        state: 1,
        flags,
        score: 0.9,
        min_px: [1.0, 1.0],
        max_px: [4.0, 4.0],
        pose: pose(tick),
        half_m: [2.0, 1.0, 0.8],
        ..bytemuck::Zeroable::zeroed()
    }
}

/// A mask of the second column's rows 1 to 3, with these runs.
pub fn mask(n_runs: u32) -> MaskRecord {
    MaskRecord {
        min_px: [1.0, 1.0],
        max_px: [2.0, 4.0],
        score: 0.6,
        class: 4,
        id: 9,
        first_run: 0,
        n_runs,
        reserved: [0; 3],
    }
}

/// Runs of [`mask`].
pub const RUNS: [u32; 3] = [7, 3, 38];

fn bytes<T: bytemuck::Pod>(records: &[T]) -> Vec<u8> {
    bytemuck::cast_slice(records).to_vec()
}

/// The body of a result of a tick.
pub fn body(kind: ResultType, tick: u64) -> Vec<u8> {
    let n_pixels = (SIZE_PX[0] * SIZE_PX[1]) as usize;
    let pixels = |n: usize| (0..n).map(|i| (i as u64 * 3 + tick) as u8).collect();
    let floats = |n: usize| bytes(&(0..n).map(|i| i as f32 + tick as f32).collect::<Vec<_>>());
    match kind {
        ResultType::Image => pixels(n_pixels * 3),
        ResultType::Tensor => floats(2 * 3 * 4),
        ResultType::Boxes2d => bytes(&[box2d(tick, 1), box2d(tick, 0)]),
        ResultType::Boxes3d => bytes(&[box3d(tick)]),
        ResultType::Tracks => bytes(&[track(tick, 3)]),
        ResultType::Masks => [bytes(&[mask(3)]), bytes(&RUNS)].concat(),
        ResultType::Keypoints => {
            let set = KeypointSet {
                score: 0.8,
                class: 12,
                id: 1,
                first_point: 0,
                n_points: 3,
                reserved: [0; 3],
            };
            let point = |i: u32| Keypoint {
                at_px: [i as f32, i as f32 + 1.0],
                score: 1.0,
                visibility: 2,
            };
            [bytes(&[set]), bytes(&[point(0), point(1), point(2)])].concat()
        }
        ResultType::Flow => floats(n_pixels * 2),
        ResultType::Depth => floats(n_pixels),
        ResultType::Semantic => pixels(n_pixels),
        ResultType::Instance => pixels(n_pixels * 4),
        ResultType::Points => floats(5 * 4),
        ResultType::Pose => bytes(&[PoseEstimate {
            pose: pose(tick),
            covariance: [0.0; 36],
        }]),
        ResultType::Odometry => bytes(&[Odometry {
            pose: pose(tick),
            velocity_mps: [3.0, 0.0, 0.0],
            ..bytemuck::Zeroable::zeroed()
        }]),
        ResultType::Path => {
            let point = |i: u64| PathPoint {
                pose: pose(tick + i),
                after_secs: i as f32,
                speed_mps: 5.0 * i as f32,
                acceleration_mps2: f32::NAN,
                curvature_pm: f32::NAN,
                reserved: [0; 2],
            };
            bytes(&[point(0), point(1), point(2)])
        }
        ResultType::Control => {
            let control = VehicleControl {
                throttle_ratio: 0.25,
                ..VehicleControl::default()
            };
            bytes(&[VehicleControlRecord::new(7, control)])
        }
        ResultType::Scalars => bytes(&[Scalar::new("speed_mps", tick as f64)]),
        ResultType::Text => format!("tick {tick}").into_bytes(),
        ResultType::Json => format!(r#"{{"tick":{tick}}}"#).into_bytes(),
        // The message `{label: "car", score: 0.5}`, whose last bytes are the double.
        ResultType::Bytes => [&b"\x0a\x03car\x11"[..], &0.5f64.to_le_bytes()].concat(),
    }
}

/// Says in the header what lies in a body of this kind.
pub fn describe(header: &mut ResultHeader, kind: ResultType, body_bytes: usize) {
    let image = |header: &mut ResultHeader, format| {
        header.set_image(SIZE_PX[0], SIZE_PX[1], format);
    };
    let body_bytes = body_bytes as u64;
    match kind {
        ResultType::Image => image(header, PixelFormat::Rgb8),
        ResultType::Flow => image(header, PixelFormat::Flow),
        ResultType::Depth => image(header, PixelFormat::Depth),
        ResultType::Semantic => image(header, PixelFormat::Class),
        ResultType::Instance => image(header, PixelFormat::Id),
        ResultType::Tensor => header.set_tensor(ElementType::F32, &[2, 3, 4]).unwrap(),
        ResultType::Masks => header.set_list(1, 48, body_bytes - 48),
        ResultType::Keypoints => header.set_list(1, 32, body_bytes - 32),
        ResultType::Points => header.set_list(body_bytes as u32 / 16, 16, 0),
        ResultType::Text | ResultType::Json | ResultType::Bytes => {
            header.set_list(body_bytes as u32, 1, 0);
        }
        _ => {
            let schema_frames::Body::Records(size) = kind.body() else {
                panic!("{kind:?} has records")
            };
            header.set_list((body_bytes / size as u64) as u32, size as u32, 0);
        }
    }
    if matches!(kind, ResultType::Masks | ResultType::Keypoints) {
        [header.width, header.height] = SIZE_PX;
    }
    if kind == ResultType::Path {
        header.space = Space::World as u32;
    }
}

/// Bodies that their headers allow, but nobody can show.
pub fn garbage(kind: ResultType) -> Option<Vec<u8>> {
    match kind {
        ResultType::Boxes2d => Some(bytes(&[Box2d {
            min_px: [f32::NAN, 0.0],
            ..box2d(1, 0)
        }])),
        // Runs beyond the image, beside a list that is too short in the next.
        ResultType::Masks => Some([bytes(&[mask(3)]), bytes(&[7, 3, 9999])].concat()),
        ResultType::Tracks => Some(bytes(&[track(u64::MAX, 1), {
            let mut bad = track(1, 3);
            bad.pose.rotation_xyzw = [f64::NAN; 4];
            bad
        }])),
        ResultType::Text => Some(vec![0xff, 0xfe]),
        ResultType::Json => Some(b"{".to_vec()),
        _ => None,
    }
}

/// The writers of all types.
pub struct Writers {
    writers: Vec<ResultPublisher>,
    boxes: ResultReader,
}

impl Writers {
    pub fn open(bus: &Bus) -> Writers {
        let writers = ResultType::ALL.iter().map(|kind| {
            let mut spec = ResultTopic::new(*kind);
            spec.about = about(*kind);
            spec.qos.buffer = 32;
            bus.result_publisher(&topic(*kind), &spec).unwrap()
        });
        Writers {
            writers: writers.collect(),
            boxes: bus.result_reader(&topic(ResultType::Boxes2d)).unwrap(),
        }
    }

    /// Smallest number of readers of any topic; our own of the boxes does not count.
    pub fn n_readers(&self) -> usize {
        let own = |it: &ResultPublisher| (it.kind() == ResultType::Boxes2d) as usize;
        let readers = self.writers.iter().map(|it| it.n_readers() - own(it));
        readers.min().unwrap_or(0)
    }

    /// Number of readers of a type's topic.
    pub fn n_readers_of(&self, kind: ResultType) -> usize {
        let writer = self.writers.iter().find(|it| it.kind() == kind);
        writer.map_or(0, ResultPublisher::n_readers)
    }

    /// Publishes a result of every type that answers `frame`.
    pub fn send(&mut self, frame: &Frame) {
        let tick = frame.header().tick;
        // Boxes go before tracks, which answer them.
        for writer in &self.writers {
            let kind = writer.kind();
            let mut loan = filled(writer, body(kind, tick));
            match kind {
                ResultType::Tracks => {
                    let boxes = self.boxes.latest().unwrap().expect("boxes were sent");
                    loan.answers(&boxes);
                }
                _ => loan.answers(frame),
            }
            loan.send().unwrap();
        }
    }

    /// Publishes what nobody can show, of the types that have such bodies.
    pub fn send_garbage(&self, frame: &Frame) {
        for writer in &self.writers {
            if let Some(body) = garbage(writer.kind()) {
                let mut loan = filled(writer, body);
                loan.answers(frame);
                loan.send().unwrap();
            }
        }
    }
}

fn filled(writer: &ResultPublisher, body: Vec<u8>) -> ResultLoan {
    let mut loan = writer.loan(body.len()).unwrap();
    loan.body_mut().copy_from_slice(&body);
    describe(loan.header_mut(), writer.kind(), body.len());
    loan
}
