//! Tasks with an answer for every pixel: what a known error gives, and that truth itself is perfect.

use schema_frames::{Modality, PixelFormat, ResultHeader, ResultType};

use super::close;
use super::scene::{
    EGO, MS, SIZE, about, actor, capture, image, plan, scenario, scored, spec, tick, views,
    with_body,
};
use crate::capture::{CapturedResult, Mode};
use crate::report::TaskScore;
use crate::suite::TaskKind;
use crate::tasks::dense::depth::Depth;
use crate::tasks::dense::event_flow::EventFlow;
use crate::tasks::dense::flow::Flow;
use crate::tasks::dense::semantic::Semantic;
use crate::tasks::dense::stereo::Stereo;
use crate::tasks::objects::masks::Masks;
use crate::tasks::{Measure, Spec, TaskRun};
use consumer_truth::ticks::TickSet;
use schema_frames::{ActorKind, FrameHeader, MaskRecord};
use schema_types::Pose;

const THINGS: [(u32, u8, f32, [u32; 4]); 2] = [
    (9, 14, 10.0, [20, 10, 60, 30]),
    (8, 12, 25.0, [100, 5, 120, 35]),
];

fn times() -> impl Iterator<Item = u64> + Clone {
    (1..6u64).map(|n| n * 100 * MS)
}

fn pixels_result<T: bytemuck::Pod>(
    kind: ResultType,
    format: PixelFormat,
    at: u64,
    pixels: &[T],
) -> CapturedResult {
    let mut header = ResultHeader::new(kind);
    header.set_image(SIZE[0], SIZE[1], format);
    with_body(header, at, at + MS, bytemuck::cast_slice(pixels))
}

/// The score of a program that answers every frame with what `answer` makes of the tick's truth.
fn run<M: Measure>(
    spec: &Spec,
    measure: M,
    truth: impl Fn(u64) -> TickSet,
    answer: impl Fn(&TickSet) -> CapturedResult,
) -> TaskScore {
    let mut capture = capture(Mode::Offline, times());
    for at in times() {
        capture.results.push(answer(&truth(at)));
    }
    let mut task = TaskRun::new(spec.clone(), Mode::Offline, plan(&[0]), measure);
    let scored = scored(&mut task, &capture, &scenario(), 0, times().map(truth));
    assert_eq!(scored.first_fault, None);
    scored.score
}

fn scene(at: u64) -> TickSet {
    tick(at, views(at, &THINGS), Vec::new())
}

fn exact<T: bytemuck::AnyBitPattern>(set: &TickSet, modality: Modality) -> Vec<T> {
    let frame = set.frames.iter().find(|frame| frame.modality == modality);
    frame.expect("a truth").elements()
}

#[test]
fn depth_that_is_a_tenth_too_far_has_an_error_of_a_tenth() {
    let asked = spec(TaskKind::Depth);
    for (factor, abs_rel, delta1) in [(1.0, 0.0, 1.0), (1.1, 0.1, 1.0), (1.3, 0.3, 0.0)] {
        let score = run(&asked, Depth::new(&asked), scene, |set| {
            let depth = exact::<f32>(set, Modality::Depth).into_iter();
            let depth: Vec<f32> = depth.map(|metres| metres * factor).collect();
            pixels_result(ResultType::Depth, PixelFormat::Depth, set.sim_nanos, &depth)
        });
        let found = score.offline["AbsRel"];
        assert!((found - abs_rel).abs() < 1e-6, "{found}");
        close(score.offline.get("d1"), delta1, "d1");
    }
    // A result of another size answers no pixel.
    let score = run(&asked, Depth::new(&asked), scene, |set| {
        let mut header = ResultHeader::new(ResultType::Depth);
        header.set_image(10, 2, PixelFormat::Depth);
        with_body(header, set.sim_nanos, set.sim_nanos, &[0; 80])
    });
    assert!(!score.offline.contains_key("AbsRel"));
    assert_eq!(score.offline.get("density").copied().unwrap_or(0.0), 0.0);
}

#[test]
fn classes_of_the_programs_own_list_give_the_overlap_of_their_pixels() {
    let mut asked = spec(TaskKind::Semantic);
    asked.classes = vec!["car".into(), "person".into(), "building".into()];
    let own = |shift: usize| {
        let mut capture = capture(Mode::Offline, times());
        for at in times() {
            let truth = exact::<u8>(&scene(at), Modality::Semantic);
            let width = SIZE[0] as usize;
            let label = |pixel: usize| {
                let (row, column) = (pixel / width, pixel % width);
                match truth[row * width + column.saturating_sub(shift)] {
                    14 => 1u8,
                    12 => 0,
                    _ => 2,
                }
            };
            let labels: Vec<u8> = (0..truth.len()).map(label).collect();
            let answer = pixels_result(ResultType::Semantic, PixelFormat::Class, at, &labels);
            capture.results.push(answer);
        }
        capture
            .abouts
            .insert("mine/out".into(), about(&["Pedestrian", "car", "Building"]));
        let measure = Semantic::new(&asked).expect("known classes");
        let mut task = TaskRun::new(asked.clone(), Mode::Offline, plan(&[0]), measure);
        scored(&mut task, &capture, &scenario(), 0, times().map(scene)).score
    };
    close(own(0).offline.get("mIoU"), 1.0, "mIoU");
    // 10 pixels to the right: the car of 40 columns overlaps itself in 30 of 50.
    let shifted = own(10);
    close(
        shifted.offline.get("IoU/car"),
        30.0 / 50.0,
        "IoU of the car",
    );
    close(
        shifted.offline.get("IoU/person"),
        10.0 / 30.0,
        "IoU of the person",
    );
}

#[test]
fn masks_of_the_truth_are_perfect_and_of_half_of_it_are_not() {
    let asked = spec(TaskKind::Masks);
    for (rows, ap) in [(20, 1.0), (10, 0.1)] {
        let score = run(&asked, Masks::new(&asked).expect("classes"), scene, |set| {
            let mut records = Vec::new();
            let mut runs: Vec<u32> = Vec::new();
            for (id, class, _, [x0, y0, x1, y1]) in THINGS {
                let y1 = if id == 9 { y0 + rows } else { y1 };
                let first_run = runs.len() as u32;
                let mask = consumer_truth::Mask::new([x0, y0, x1, y1], |_, _| true);
                let own = mask.runs(SIZE[0], SIZE[1]);
                let mut record: MaskRecord = bytemuck::Zeroable::zeroed();
                (record.class, record.score) = (u32::from(class), 0.8);
                (record.first_run, record.n_runs) = (first_run, own.len() as u32);
                runs.extend(own);
                records.push(record);
            }
            let mut header = ResultHeader::new(ResultType::Masks);
            let tail = runs.len() as u64 * 4;
            header.set_list(records.len() as u32, size_of::<MaskRecord>() as u32, tail);
            (header.width, header.height) = (SIZE[0], SIZE[1]);
            let mut body = bytemuck::cast_slice::<_, u8>(&records).to_vec();
            body.extend(bytemuck::cast_slice::<_, u8>(&runs));
            with_body(header, set.sim_nanos, set.sim_nanos, &body)
        });
        // Half of the car's rows overlap its mask by 1/2: the first of ten thresholds.
        close(score.offline.get("AP/car"), ap, "AP of the car");
        close(score.offline.get("AP/person"), 1.0, "AP of the person");
    }
}

#[test]
fn disparity_is_focal_length_times_baseline_over_depth() {
    let mut asked = spec(TaskKind::Stereo);
    asked.options.baseline_m = 0.5;
    let answer = |off: f32| {
        run(&asked, Stereo::new(&asked), scene, |set| {
            let depth = exact::<f32>(set, Modality::Depth).into_iter();
            let disparity: Vec<f32> = depth.map(|metres| 100.0 * 0.5 / metres + off).collect();
            pixels_result(
                ResultType::Image,
                PixelFormat::Mono32f,
                set.sim_nanos,
                &disparity,
            )
        })
    };
    close(answer(0.0).offline.get("D1"), 0.0, "D1");
    close(answer(0.0).offline.get("EPE"), 0.0, "EPE");
    // Disparities are 5, 2 and 1 pixels: 4 more are beyond 3 pixels and 5 % everywhere.
    close(answer(4.0).offline.get("D1"), 100.0, "D1");
    // The same as depth.
    let as_depth = run(&asked, Stereo::new(&asked), scene, |set| {
        let depth = exact::<f32>(set, Modality::Depth);
        pixels_result(ResultType::Depth, PixelFormat::Depth, set.sim_nanos, &depth)
    });
    assert!(as_depth.offline["EPE"] < 1e-6);
    // Of each row the first pixels have their partner outside of the right image: of the wall,
    // whose disparity is 1, those whose middle lies at 0.5.
    let n: u64 = u64::from(SIZE[0] * SIZE[1]) - u64::from(SIZE[1]);
    assert_eq!(as_depth.n_scored, n * 5);
}

/// A truth of flow: the whole image moves by 3 pixels to the right, and so does a car that drives.
fn moving(topic: &'static str) -> impl Fn(u64) -> TickSet {
    move |at| {
        let n = (SIZE[0] * SIZE[1]) as usize;
        let flow = vec![[3f32, 0.0]; n];
        let bonnet = (EGO, 14, 1.0, [150, 30, 200, 40]);
        let mut frames = views(at, &[THINGS[0], THINGS[1], bonnet]);
        let mut frame = image(topic, Modality::Flow, at, Pose::IDENTITY, &flow);
        frame.header.window_nanos = 100 * MS;
        frames.push(frame);
        let car = actor(9, ActorKind::Vehicle, 14, Pose::IDENTITY, [5.0, 0.0, 0.0]);
        let person = actor(8, ActorKind::Walker, 12, Pose::IDENTITY, [0.1, 0.0, 0.0]);
        tick(at, frames, vec![person, car])
    }
}

#[test]
fn flow_is_split_by_what_moves() {
    let mut asked = spec(TaskKind::Flow);
    asked.truth = "ego/front".into();
    let truth = moving("ego/front/flow");
    let answer = |of_car: [f32; 2], of_rest: [f32; 2]| {
        run(&asked, Flow::new(&asked), &truth, |set| {
            let ids = exact::<u32>(set, Modality::Instance).into_iter();
            let flow: Vec<[f32; 2]> = ids
                .map(|id| if id == 9 { of_car } else { of_rest })
                .collect();
            pixels_result(ResultType::Flow, PixelFormat::Flow, set.sim_nanos, &flow)
        })
    };
    let perfect = answer([3.0, 0.0], [3.0, 0.0]);
    for metric in ["EPE", "Fl", "EPE/moving", "EPE/static"] {
        close(perfect.offline.get(metric), 0.0, metric);
    }
    // The car is 4 pixels off, downwards, the person within what stands still.
    let blind = answer([3.0, 4.0], [3.0, 0.0]);
    close(blind.offline.get("EPE/moving"), 4.0, "EPE of the car");
    close(blind.offline.get("EPE/static"), 0.0, "EPE of the rest");
    close(blind.offline.get("Fl/moving"), 100.0, "Fl of the car");
    // The carrier's bonnet, 10 rows of 50 columns, is left out.
    let n = SIZE[0] * SIZE[1] - 500;
    assert_eq!(blind.n_scored, u64::from(5 * n));
    let share = f64::from(40 * 20) / f64::from(n);
    close(blind.offline.get("EPE"), 4.0 * share, "EPE");
}

#[test]
fn the_first_frame_of_flow_has_no_truth_and_event_flow_has_windows_of_its_own() {
    let mut asked = spec(TaskKind::EventFlow);
    asked.truth = "ego/front_truth10".into();
    let truth = moving("ego/front_truth10/flow");
    let first = |at: u64| {
        let mut set = truth(at);
        if at == 100 * MS {
            for frame in &mut set.frames {
                frame.header.flags |= FrameHeader::FIRST;
            }
        }
        // Every second frame of the events ends no window.
        if at == 300 * MS {
            set.frames.retain(|frame| frame.modality != Modality::Flow);
        }
        set
    };
    let score = run(&asked, EventFlow::new(&asked), first, |set| {
        let flow = vec![[3f32, 2.0]; (SIZE[0] * SIZE[1]) as usize];
        pixels_result(ResultType::Flow, PixelFormat::Flow, set.sim_nanos, &flow)
    });
    close(score.offline.get("EPE"), 2.0, "EPE");
    assert_eq!(score.n_scored, 3 * u64::from(SIZE[0] * SIZE[1]));
}
