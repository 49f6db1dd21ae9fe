//! A detector that cannot err, for trying viewer, recorder and topic tools with results: it reads
//! the ids of a camera's pixels and publishes boxes and masks on its colour image, boxes in the
//! world, a path and a few numbers: `cargo run --example publish_truth -- DOMAIN [RIG/SENSOR]`.

use std::collections::BTreeMap;

use consumer_kit::{Follower, MAX_WAIT, Publisher, Take};
use schema_bus::{Frame, ResultTopic};
use schema_frames::{ActorKind, Box2d, Box3d, MaskRecord, PathPoint, ResultType, Scalar, Space};
use schema_types::Pose;

/// Objects with fewer pixels are not reported.
const MIN_PIXELS: u32 = 30;

/// What a camera sees of one object: box, and runs of its mask column by column.
#[derive(Default)]
struct Seen {
    min: [u32; 2],
    max: [u32; 2],
    n_pixels: u32,
    runs: Vec<u32>,
    /// Number of the pixel after the last run.
    end: u32,
}

fn look(frame: &Frame) -> BTreeMap<u32, Seen> {
    let header = frame.header();
    let mut seen: BTreeMap<u32, Seen> = BTreeMap::new();
    for (x, y) in (0..header.width).flat_map(|x| (0..header.height).map(move |y| (x, y))) {
        let at = y as usize * header.row_stride as usize + x as usize * 4;
        let id = u32::from_le_bytes(frame[at..at + 4].try_into().expect("four bytes"));
        // Ids from 2³¹ on are scenery.
        if id == 0 || id >= 1 << 31 {
            continue;
        }
        let pixel = x * header.height + y;
        let object = seen.entry(id).or_insert_with(|| Seen {
            min: [x, y],
            ..Seen::default()
        });
        object.min = [object.min[0].min(x), object.min[1].min(y)];
        object.max = [object.max[0].max(x + 1), object.max[1].max(y + 1)];
        object.n_pixels += 1;
        match object.runs.last_mut().filter(|_| object.end == pixel) {
            Some(run) => *run += 1,
            None => object.runs.extend([pixel - object.end, 1]),
        }
        object.end = pixel + 1;
    }
    seen.retain(|_, object| object.n_pixels >= MIN_PIXELS);
    seen
}

fn main() -> anyhow::Result<()> {
    let shutdown = launch_cli::Shutdown::install()?;
    let mut args = std::env::args().skip(1);
    let domain = args
        .next()
        .unwrap_or_else(schema_bus::names::default_domain);
    let sensor = args.next().unwrap_or_else(|| "ego/front".to_string());
    let mut follower = Follower::open(&domain, "truth")?;
    let [colour, ids] = ["rgb", "instance"].map(|it| format!("{sensor}/{it}"));
    let [colour, ids] = [colour, ids].map(|it| follower.follow(&it, Take::Newest));
    let bus = follower.bus();
    let boxes = Publisher::<Box2d>::open(bus, "truth/boxes")?;
    let solids = Publisher::<Box3d>::open(bus, "truth/solids")?;
    let paths = Publisher::<PathPoint>::open(bus, "truth/path")?;
    let numbers = Publisher::<Scalar>::open(bus, "truth/numbers")?;
    let masks = bus.result_publisher("truth/masks", &ResultTopic::new(ResultType::Masks))?;
    let words = bus.result_publisher("truth/words", &ResultTopic::new(ResultType::Text))?;
    let mut newest: [Option<Frame>; 2] = [None, None];
    while !shutdown.requested() {
        follower.wait(MAX_WAIT)?;
        for (slot, topic) in newest.iter_mut().zip([colour, ids]) {
            if let Some(frame) = follower.take(topic)? {
                *slot = Some(frame);
            }
        }
        let [Some(colour), Some(ids)] = &newest else {
            continue;
        };
        let tick = ids.header().tick;
        let Some(world) = follower
            .world_at(tick)?
            .filter(|_| colour.header().tick == tick)
        else {
            continue;
        };
        let seen = look(ids);
        let class = |id: u32| world.actor(id).map_or(0, |actor| actor.class as u32);
        let corner = |at: [u32; 2]| at.map(|px| px as f32);
        let found: Vec<Box2d> = seen
            .iter()
            .map(|(id, object)| Box2d {
                min_px: corner(object.min),
                max_px: corner(object.max),
                score: 1.0,
                class: class(*id),
                id: *id,
                reserved: 0,
            })
            .collect();
        boxes.send(&found, &[colour, ids])?;

        let mut first_run = 0;
        let records: Vec<MaskRecord> = found
            .iter()
            .zip(seen.values())
            .map(|(it, object)| {
                let record = MaskRecord {
                    min_px: it.min_px,
                    max_px: it.max_px,
                    score: 1.0,
                    class: it.class,
                    id: it.id,
                    first_run,
                    n_runs: object.runs.len() as u32,
                    reserved: [0; 3],
                };
                first_run += record.n_runs;
                record
            })
            .collect();
        let runs: Vec<u32> = seen
            .values()
            .flat_map(|it| it.runs.iter().copied())
            .collect();
        let body = [
            bytemuck::cast_slice(&records),
            bytemuck::cast_slice::<u32, u8>(&runs),
        ]
        .concat();
        let mut loan = masks.loan(body.len())?;
        loan.body_mut().copy_from_slice(&body);
        loan.set_list(records.len() as u32, 48, runs.len() as u64 * 4)?;
        loan.answers(colour);
        loan.answers(ids);
        loan.send()?;

        let in_sight = |id: &u32| {
            world
                .actor(*id)
                .filter(|it| it.kind() == Some(ActorKind::Vehicle))
        };
        let mut list = solids.loan(seen.len())?;
        list.header_mut().space = Space::World as u32;
        list.answers(ids);
        let mut n_solids = 0;
        for actor in seen.keys().filter_map(in_sight) {
            let lift = Pose::from_xyz_yaw(0.0, 0.0, actor.half_box_m[2] as f64, 0.0);
            list[n_solids] = Box3d {
                pose: (actor.world_from_actor.isometry() * lift.isometry()).into(),
                half_m: actor.half_box_m.map(|half| half * 1.05),
                velocity_mps: actor.velocity_in_world_mps.map(|v| v as f32),
                score: 1.0,
                class: actor.class as u32,
                id: actor.id,
                n_points: 0,
                reserved: [0; 2],
            };
            n_solids += 1;
        }
        list.send(n_solids)?;

        let Some(ego) = world.actor(ids.header().parent_id) else {
            continue;
        };
        let ahead = |i: u32| PathPoint {
            pose: (ego.world_from_actor.isometry()
                * Pose::from_xyz_yaw(2.0 + 1.5 * i as f64, 0.0, 0.3, 0.0).isometry())
            .into(),
            after_secs: f32::NAN,
            speed_mps: 20.0 - i as f32,
            acceleration_mps2: f32::NAN,
            curvature_pm: 0.0,
            reserved: [0; 2],
        };
        paths.send(&(0..20).map(ahead).collect::<Vec<_>>(), &[ids])?;
        let values = [
            ("objects", found.len() as f64),
            ("speed_mps", ego.speed_mps()),
        ];
        let values = values.map(|(name, value)| Scalar::new(name, value));
        numbers.send(&values, &[ids])?;
        let text = format!("{} objects, {n_solids} of them vehicles", found.len());
        let mut loan = words.loan(text.len())?;
        loan.body_mut().copy_from_slice(text.as_bytes());
        loan.set_list(text.len() as u32, 1, 0)?;
        loan.answers(ids);
        loan.send()?;
        newest = [None, None];
    }
    Ok(())
}
