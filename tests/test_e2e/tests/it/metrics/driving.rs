//! Drives against SciPy: derivatives against its Savitzky-Golay filter, times to collision against
//! its convex hulls, the rest against the formulas of the CARLA leaderboard and of nuPlan in NumPy.

use consumer_metrics::driving::{Body, Collector, CollisionWith, Drive, Infraction, Settings};
use serde_json::{Value, json};
use test_e2e::judged::judge;

use super::{Rng, case, normal};

fn written(body: &Body) -> Value {
    json!({
        "centre": body.centre_m,
        "heading": body.heading_rad,
        "velocity": body.velocity_mps,
        "half": body.half_m,
    })
}

fn random_drive(rng: &mut Rng, collector: &mut Collector) -> Value {
    let interval_secs = [0.02, 0.05, 0.1][rng.usize(0..3)];
    let route_m = 50.0 + 200.0 * rng.f64();
    let mut drive = Drive::new(interval_secs, route_m);
    let rough = [0.0, 0.05, 0.6][rng.usize(0..3)];
    let mut moments = Vec::new();
    let (mut centre_m, mut heading_rad, mut speed) = ([0.0; 2], normal(rng), 8.0);
    for _ in 0..rng.usize(3..120) {
        let yaw_rate = 0.2 * normal(rng);
        speed += interval_secs * normal(rng) + rough * normal(rng) * interval_secs.sqrt();
        heading_rad += interval_secs * yaw_rate;
        let velocity_mps = [speed * heading_rad.cos(), speed * heading_rad.sin()];
        centre_m = [0, 1].map(|axis| centre_m[axis] + interval_secs * velocity_mps[axis]);
        let ego = Body {
            centre_m,
            heading_rad,
            velocity_mps,
            half_m: [2.2, 0.9],
        };
        let others: Vec<Body> = (0..rng.usize(0..4))
            .map(|_| Body {
                centre_m: centre_m.map(|at| at + 30.0 * normal(rng)),
                heading_rad: 3.0 * normal(rng),
                velocity_mps: [0; 2].map(|_| 8.0 * normal(rng)),
                half_m: [0; 2].map(|_| 0.3 + 2.0 * rng.f64()),
            })
            .collect();
        drive.add(&ego, yaw_rate, &others);
        moments.push(json!({
            "ego": written(&ego),
            "yaw_rate": yaw_rate,
            "others": others.iter().map(written).collect::<Vec<_>>(),
        }));
    }
    let mut collisions = Vec::new();
    for (with, name) in [
        (CollisionWith::Walker, "walker"),
        (CollisionWith::Vehicle, "vehicle"),
        (CollisionWith::Static, "static"),
    ] {
        for _ in 0..rng.usize(0..3) {
            let impulse = 1000.0 * rng.f64();
            drive.collide(with, impulse);
            collisions.push(json!([name, impulse]));
        }
    }
    let (n_red_lights, n_stop_signs) = (rng.u8(0..3), rng.u8(0..3));
    (0..n_red_lights).for_each(|_| drive.infringe(Infraction::RedLight));
    (0..n_stop_signs).for_each(|_| drive.infringe(Infraction::StopSign));
    let (completed_m, off_road_m) = (1.2 * route_m * rng.f64(), 10.0 * rng.f64());
    drive.complete(completed_m);
    drive.off_road(off_road_m);
    collector.add(&drive);
    json!({
        "interval": interval_secs,
        "route": route_m,
        "completed": completed_m,
        "off_road": off_road_m,
        "moments": moments,
        "collisions": collisions,
        "red_lights": n_red_lights,
        "stop_signs": n_stop_signs,
    })
}

fn driving_case(seed: u64) -> String {
    let mut rng = Rng::with_seed(seed);
    let settings = Settings::default();
    let mut whole = Collector::new(settings);
    let mut drives = Vec::new();
    for _ in 0..rng.usize(1..4) {
        let mut part = Collector::new(settings);
        drives.push(random_drive(&mut rng, &mut part));
        whole.merge(&part);
    }
    case("driving", json!(drives), &whole.scores().named())
}

#[test]
fn drives_score_as_elsewhere() {
    let cases: Vec<String> = (0..60).map(driving_case).collect();
    judge("metrics_driving.py", &cases, 1200);
}
