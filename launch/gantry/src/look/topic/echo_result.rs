//! A result as a JSON object: what it says, the inputs that it answers, and how long it took.

use schema_bus::ResultSample;
use schema_frames::{
    About, Box2d, Box3d, ElementType, KeypointSet, MaskRecord, Odometry, PathPoint, PixelFormat,
    PoseEstimate, ResultType, Scalar, Track, VehicleControlRecord,
};
use schema_types::Pose;
use serde_json::{Map, Value, json};

use super::fields::{debug_fields, first, hex, number};
use super::statistics::{Statistics, of_elements};

pub fn result_value(result: &ResultSample, about: &About, n: usize) -> Value {
    let header = result.header();
    let published = header.published_mono_nanos;
    let inputs = result.inputs().iter().map(|input| {
        let known = input.published_mono_nanos != 0;
        json!({
            "topic": input.topic(), "tick": input.tick, "seq": input.seq, "epoch": input.epoch.to_string(),
            "latency_nanos": known.then(|| published.saturating_sub(input.published_mono_nanos)),
        })
    });
    let since_sensor =
        (header.origin_mono_nanos != 0).then(|| published.saturating_sub(header.origin_mono_nanos));
    let mut value = json!({
        "type": result.kind().name(),
        "tick": header.tick, "sim_nanos": header.sim_nanos, "seq": header.seq,
        "episode": header.episode, "epoch": header.epoch.to_string(), "writer_epoch": header.writer_epoch.to_string(),
        "flags": header.flags, "space": header.space().map(|space| space.name()), "body_bytes": header.body_bytes,
        "published_mono_nanos": published, "since_sensor_nanos": since_sensor,
        "inputs": inputs.collect::<Value>(),
    });
    let content = content(result, about, n);
    if let (Value::Object(all), Value::Object(content)) = (&mut value, content) {
        all.extend(content);
    }
    value
}

/// What the body says; of lists the first `n`, and how many there are.
fn content(result: &ResultSample, about: &About, n: usize) -> Value {
    let header = result.header();
    let class = |class: u32| about.class_name(class);
    let listed = |name: &str, list: Value| {
        let mut object = Map::new();
        object.insert(format!("n_{name}"), header.n_items.into());
        object.insert(name.to_owned(), list);
        Value::Object(object)
    };
    match result.kind() {
        ResultType::Image
        | ResultType::Flow
        | ResultType::Depth
        | ResultType::Semantic
        | ResultType::Instance => pixels(result),
        ResultType::Tensor => tensor(result),
        ResultType::Boxes2d => listed(
            "boxes",
            first(
                result.records(),
                n,
                |a: &Box2d| json!({"class": class(a.class), "score": number(a.score), "id": a.id, "min_px": a.min_px.map(number), "max_px": a.max_px.map(number)}),
            ),
        ),
        ResultType::Boxes3d => listed(
            "boxes",
            first(
                result.records(),
                n,
                |a: &Box3d| json!({"class": class(a.class), "score": number(a.score), "id": a.id, "pose": pose(&a.pose), "half_m": a.half_m.map(number), "velocity_mps": a.velocity_mps.map(number), "n_points": a.n_points}),
            ),
        ),
        ResultType::Tracks => listed("tracks", first(result.records(), n, |a| track(a, about))),
        ResultType::Masks => listed(
            "masks",
            first(result.records(), n, |a: &MaskRecord| {
                let runs = result.runs_of(a).unwrap_or_default();
                // Runs of background and object come in turn, background first.
                let n_pixels: u64 = runs.iter().skip(1).step_by(2).map(|n| *n as u64).sum();
                json!({"class": class(a.class), "score": number(a.score), "id": a.id, "min_px": a.min_px.map(number), "max_px": a.max_px.map(number), "n_pixels": n_pixels})
            }),
        ),
        ResultType::Keypoints => listed(
            "sets",
            first(result.records(), n, |a: &KeypointSet| {
                let points = first(result.points_of(a), usize::MAX, |point| {
                    json!([number(point.at_px[0]), number(point.at_px[1])])
                });
                json!({"class": class(a.class), "score": number(a.score), "id": a.id, "points_px": points})
            }),
        ),
        ResultType::Points => listed("points", points(result, about, n)),
        ResultType::Pose => {
            let estimate: Option<&PoseEstimate> = result.records().and_then(|list| list.first());
            estimate.map_or(
                json!({}),
                |a| json!({"pose": pose(&a.pose), "deviations": deviations(&a.covariance)}),
            )
        }
        ResultType::Odometry => {
            let odometry: Option<&Odometry> = result.records().and_then(|list| list.first());
            odometry.map_or(json!({}), |a| {
                json!({"pose": pose(&a.pose), "velocity_mps": a.velocity_mps, "angular_velocity_radps": a.angular_velocity_radps, "deviations": deviations(&a.pose_covariance)})
            })
        }
        ResultType::Path => listed(
            "points",
            first(
                result.records(),
                n,
                |a: &PathPoint| json!({"pose": pose(&a.pose), "after_secs": number(a.after_secs), "speed_mps": number(a.speed_mps), "curvature_pm": number(a.curvature_pm)}),
            ),
        ),
        ResultType::Control => listed(
            "controls",
            first(result.records(), n, |a: &VehicleControlRecord| {
                debug_fields(a)
            }),
        ),
        ResultType::Scalars => {
            let scalars = result.records::<Scalar>().unwrap_or_default();
            let one = |scalar: &Scalar| (scalar.name(), json!(scalar.value));
            json!({"scalars": scalars.iter().map(one).collect::<Map<_, _>>()})
        }
        ResultType::Text => json!({"text": String::from_utf8_lossy(result)}),
        ResultType::Json => json!({
            "json": serde_json::from_slice::<Value>(result)
                .unwrap_or_else(|_| String::from_utf8_lossy(result).into()),
        }),
        ResultType::Bytes => {
            let schema = about.schema.clone().unwrap_or_default();
            json!({"bytes": header.body_bytes, "first_bytes": hex(result), "message": schema.name, "message_encoding": schema.message_encoding})
        }
    }
}

fn track(a: &Track, about: &About) -> Value {
    let states = ["tentative", "confirmed", "lost", "ended"];
    let state = states
        .get(a.state as usize)
        .map_or(json!(a.state), |name| json!(name));
    let mut value = json!({"id": a.id, "class": about.class_name(a.class), "state": state, "score": number(a.score), "age_secs": number(a.age_secs), "n_hits": a.n_hits, "n_missed": a.n_missed});
    if a.flags & Track::IN_IMAGE != 0 {
        value["min_px"] = json!(a.min_px.map(number));
        value["max_px"] = json!(a.max_px.map(number));
    }
    if a.flags & Track::IN_SPACE != 0 {
        value["pose"] = pose(&a.pose);
        value["half_m"] = json!(a.half_m.map(number));
        value["velocity_mps"] = json!(a.velocity_mps.map(number));
    }
    value
}

fn pose(pose: &Pose) -> Value {
    json!({"translation_m": pose.translation_m, "rotation_xyzw": pose.rotation_xyzw})
}

/// Square roots of the diagonal: metres along x, y, z and radians about them; null if not known.
fn deviations(covariance: &[f64; 36]) -> Value {
    match covariance.iter().all(|value| *value == 0.0) {
        true => Value::Null,
        false => (0..6).map(|i| json!(covariance[i * 7].sqrt())).collect(),
    }
}

/// Size and format of an image, and where a pixel is one number its least, mean and greatest.
fn pixels(result: &ResultSample) -> Value {
    let header = result.header();
    let format = header.pixel_format();
    let mut value = json!({"format": format.map(|format| format.name()), "width": header.width, "height": header.height, "row_stride": header.row_stride});
    let element = match format {
        Some(PixelFormat::Depth | PixelFormat::Mono32f) => ElementType::F32,
        Some(PixelFormat::Mono16) => ElementType::U16,
        Some(PixelFormat::Mono8 | PixelFormat::Class) => ElementType::U8,
        _ => return value,
    };
    let mut statistics = Statistics::default();
    for y in 0..header.height {
        statistics.add(element, result.row(y).unwrap_or_default());
    }
    statistics.into_object(&mut value);
    value
}

fn tensor(result: &ResultSample) -> Value {
    let header = result.header();
    let of = header.element_type();
    let mut value = json!({"dtype": of.map(|of| of.name()), "shape": header.shape()});
    if let Some(of) = of {
        let mut statistics = Statistics::default();
        statistics.add(of, result);
        statistics.into_object(&mut value);
    }
    value
}

/// The first `n` points with their fields by name.
fn points(result: &ResultSample, about: &About, n: usize) -> Value {
    let (fields, _) = about.point_fields();
    let point_bytes = (result.header().element_bytes as usize).max(1);
    let point = |bytes: &[u8]| {
        let field = |field: &schema_frames::PointField| {
            let of = ElementType::from_name(&field.element)?;
            let start = field.offset as usize;
            let bytes = bytes.get(start..start + of.element_bytes())?;
            Some((field.name.clone(), json!(of_elements(of, bytes).next()?)))
        };
        Value::Object(fields.iter().filter_map(field).collect())
    };
    result
        .chunks_exact(point_bytes)
        .take(n)
        .map(point)
        .collect()
}
