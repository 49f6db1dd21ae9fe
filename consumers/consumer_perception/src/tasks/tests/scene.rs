//! Truths and programs made by hand: what stands where is known in closed form.

use std::sync::Arc;

use bytemuck::Pod;
use consumer_truth::scenario::Scenario;
use consumer_truth::ticks::{TickFrame, TickSet, World};
use schema_frames::document::Weather;
use schema_frames::{
    About, ActorKind, ActorRecord, FrameHeader, InputRecord, Modality, ResultHeader, ResultType,
    SnapshotHeader, StepMode, WorldInfo,
};
use schema_types::Pose;

use crate::capture::{Body, Capture, CapturedResult, Clock, Mode, SentFrame};
use crate::evidence::ignore::Rules;
use crate::evidence::moment::Moment;
use crate::evidence::queries::Answers;
use crate::suite::TaskKind;
use crate::tasks::{AnyTask, Context, Options, Plan, Scored, Spec};

/// Columns and rows of all images.
pub const SIZE: [u32; 2] = [200, 40];

/// The carrier's id.
pub const EGO: u32 = 1;

pub const MS: u64 = 1_000_000;

/// Monotonic time of simulated time 0, nanoseconds.
const ZERO_MONO: u64 = 7_000_000_000;

/// A task as the tests ask for it: input `ego/front/rgb`, truth `ego/front_truth`.
pub fn spec(kind: TaskKind) -> Spec {
    Spec {
        name: kind.name().into(),
        kind,
        topic: "mine/out".into(),
        input: "ego/front/rgb".into(),
        truth: "ego/front_truth".into(),
        images: "ego/front_truth".into(),
        classes: Vec::new(),
        rules: Rules::default(),
        options: Options::default(),
    }
}

/// A frame of an image with the tests' camera at a pose.
pub fn image<T: Pod>(
    topic: &str,
    modality: Modality,
    sim_nanos: u64,
    pose: Pose,
    pixels: &[T],
) -> TickFrame {
    let mut header = FrameHeader::new(modality);
    header.set_image(SIZE[0], SIZE[1]);
    header.sim_nanos = sim_nanos;
    header.tick = sim_nanos / MS;
    header.intrinsics_px = [
        100.0,
        100.0,
        f64::from(SIZE[0]) / 2.0,
        f64::from(SIZE[1]) / 2.0,
    ];
    header.world_from_sensor = pose;
    TickFrame {
        topic: topic.into(),
        modality,
        header,
        payload: bytemuck::cast_slice(pixels).to_vec(),
    }
}

/// A list of records, as a lidar's.
pub fn list<T: Pod>(topic: &str, modality: Modality, sim_nanos: u64, records: &[T]) -> TickFrame {
    let mut frame = image::<u8>(topic, modality, sim_nanos, Pose::IDENTITY, &[]);
    frame.header.set_list(records.len() as u32);
    frame.payload = bytemuck::cast_slice(records).to_vec();
    frame
}

/// A rectangle of pixels `[x0, y0, x1, y1]` that shows an object: id, class, depth in metres.
pub type Thing = (u32, u8, f32, [u32; 4]);

/// Instance, semantic and depth images of some things before a wall 50 m away.
pub fn views(sim_nanos: u64, things: &[Thing]) -> Vec<TickFrame> {
    let n = (SIZE[0] * SIZE[1]) as usize;
    let (mut ids, mut classes, mut depth) = (vec![0u32; n], vec![3u8; n], vec![50f32; n]);
    for (id, class, metres, [x0, y0, x1, y1]) in things {
        for y in *y0..(*y1).min(SIZE[1]) {
            for x in *x0..(*x1).min(SIZE[0]) {
                let at = (y * SIZE[0] + x) as usize;
                (ids[at], classes[at], depth[at]) = (*id, *class, *metres);
            }
        }
    }
    let pose = Pose::IDENTITY;
    vec![
        image(
            "ego/front_truth/instance",
            Modality::Instance,
            sim_nanos,
            pose,
            &ids,
        ),
        image(
            "ego/front_truth/semantic",
            Modality::Semantic,
            sim_nanos,
            pose,
            &classes,
        ),
        image(
            "ego/front_truth/depth",
            Modality::Depth,
            sim_nanos,
            pose,
            &depth,
        ),
    ]
}

/// An actor at a pose with a velocity.
pub fn actor(id: u32, kind: ActorKind, class: u8, pose: Pose, velocity: [f64; 3]) -> ActorRecord {
    let mut record: ActorRecord = bytemuck::Zeroable::zeroed();
    record.id = id;
    record.kind = kind as u16;
    record.class = class;
    record.world_from_actor = pose;
    record.velocity_in_world_mps = velocity;
    record.half_box_m = [2.0, 1.0, 0.75];
    record
}

/// A tick with frames and actors; one tick is a millisecond.
pub fn tick(sim_nanos: u64, frames: Vec<TickFrame>, records: Vec<ActorRecord>) -> TickSet {
    let mut header: SnapshotHeader = bytemuck::Zeroable::zeroed();
    (header.tick, header.sim_nanos) = (sim_nanos / MS, sim_nanos);
    TickSet {
        tick: sim_nanos / MS,
        sim_nanos,
        key: None,
        world: Some(Arc::new(World {
            header,
            records,
            actors: Arc::default(),
            scenery: Arc::default(),
        })),
        frames,
    }
}

/// A capture with frames of the input at these times and no results yet. A second of simulated time
/// is one of the wall clock.
pub fn capture(mode: Mode, frames_nanos: impl IntoIterator<Item = u64>) -> Capture {
    let mut clock = Clock::default();
    clock.push(0, ZERO_MONO);
    clock.push(1_000_000_000, ZERO_MONO + 1_000_000_000);
    let frames = frames_nanos.into_iter().enumerate();
    Capture {
        program: "fake".into(),
        scenario: "hand".into(),
        mode,
        speed: 1.0,
        added_delay_nanos: 0,
        clock,
        results: Vec::new(),
        abouts: Default::default(),
        frames: frames
            .map(|(seq, sim_nanos)| SentFrame {
                topic: "ego/front/rgb".into(),
                tick: sim_nanos / MS,
                seq: seq as u64 + 1,
                epoch: 0,
                sim_nanos,
                published_mono_nanos: ZERO_MONO + sim_nanos,
            })
            .collect(),
        n_lost: 0,
        n_refused: 0,
        usage: Vec::new(),
        faults: Vec::new(),
        has_crashed: false,
        drive_recording: None,
    }
}

/// A result of records that answers the frame of `frame_nanos` and was published at
/// `published_nanos`, both simulated.
pub fn result<T: Pod>(
    kind: ResultType,
    frame_nanos: u64,
    published_nanos: u64,
    records: &[T],
) -> CapturedResult {
    let mut header = ResultHeader::new(kind);
    header.set_list(records.len() as u32, size_of::<T>() as u32, 0);
    with_body(
        header,
        frame_nanos,
        published_nanos,
        bytemuck::cast_slice(records),
    )
}

/// A result with a header of its own.
pub fn with_body(
    mut header: ResultHeader,
    frame_nanos: u64,
    published_nanos: u64,
    body: &[u8],
) -> CapturedResult {
    header.tick = frame_nanos / MS;
    header.sim_nanos = frame_nanos;
    header.published_mono_nanos = ZERO_MONO + published_nanos;
    let mut input = InputRecord::new("ego/front/rgb");
    input.tick = frame_nanos / MS;
    input.sim_nanos = frame_nanos;
    CapturedResult {
        topic: "mine/out".into(),
        header,
        body: Body::Held(body.into()),
        inputs: vec![input],
        held_mono_nanos: ZERO_MONO + published_nanos,
    }
}

/// What a recording without sensors' places and map says of itself.
pub fn scenario() -> Scenario {
    Scenario {
        name: "hand".into(),
        index: 0,
        split: String::new(),
        rig: "ego".into(),
        carrier_id: EGO,
        info: WorldInfo {
            source: "live".into(),
            version: String::new(),
            epoch: "0".into(),
            episode: 1,
            map: String::new(),
            seed: 0,
            mode: StepMode::Stepped,
            period_nanos: MS,
            episode_start_nanos: 0,
            lockstep: Vec::new(),
            weather: Weather::default(),
            adapter: String::new(),
            cpu_copies: 0,
            batches: Vec::new(),
            cameras: Vec::new(),
        },
        start_nanos: 0,
        end_nanos: u64::MAX,
        sensors: Vec::new(),
        opendrive: None,
    }
}

/// Delays of the tests, nanoseconds.
pub fn plan(delays_ms: &[u64]) -> Plan {
    Plan {
        delays_nanos: delays_ms.iter().map(|ms| (ms * MS) as f64).collect(),
        n_worst: 3,
    }
}

/// Shows a task all ticks and takes what it scored; frames before `from_nanos` do not count.
pub fn scored(
    task: &mut dyn AnyTask,
    capture: &Capture,
    about: &Scenario,
    from_nanos: u64,
    ticks: impl IntoIterator<Item = TickSet>,
) -> Scored {
    scored_in(task, capture, about, from_nanos, ticks, false)
}

/// As [`scored`], in a world that is sealed or not.
pub fn scored_in(
    task: &mut dyn AnyTask,
    capture: &Capture,
    about: &Scenario,
    from_nanos: u64,
    ticks: impl IntoIterator<Item = TickSet>,
    is_sealed: bool,
) -> Scored {
    let spec = task.spec().clone();
    let answers = Answers::of(
        capture,
        &capture.frames,
        &spec.topic,
        &spec.input,
        (from_nanos, u64::MAX),
        capture.added_delay_nanos,
    );
    let context = Context {
        scenario: about,
        spec: &spec,
        is_sealed,
    };
    task.begin(&context, answers, 1)
        .expect("nothing is missing");
    let views: Vec<Arc<str>> = vec![spec.truth.as_str().into(), spec.images.as_str().into()];
    for set in ticks {
        let mut moment = Moment::new(&set, EGO, &views);
        moment.is_query = true;
        task.tick(&moment, capture, set.sim_nanos >= from_nanos);
    }
    task.end(capture).expect("nothing is read")
}

/// The description of a topic with these classes.
pub fn about(classes: &[&str]) -> About {
    About {
        classes: classes.iter().map(|name| name.to_string()).collect(),
        ..About::default()
    }
}
