//! The program as a process beside a simulator, both in a domain and shared memory of their own.

use consumer_kit::schema_frames::Box2d;
use test_kit::{Setup, Simulator};

/// The launch file without traffic, and with the numbers of the objects in the image.
fn setup() -> Setup {
    Setup::file(concat!(env!("CARGO_MANIFEST_DIR"), "/launch.toml"))
        .set("scenario.vehicles=0")
        .set("sensor.front.modalities=[\"semantic\", \"instance\"]")
        .set("sensor.front.width_px=320")
        .set("sensor.front.height_px=240")
}

#[test]
fn every_image_is_answered_and_the_car_ahead_has_an_exact_box() {
    let mut simulator = Simulator::start(setup());
    let car = simulator.spawn_near_ego("vehicle.audi.tt", [12.0, 0.0, 0.3]);
    let program = simulator.run(env!("CARGO_BIN_EXE_{{name}}"), &[]);
    let mut boxes = simulator.results("{{name}}/boxes");
    let mut objects = simulator.frames("ego/front/instance");
    simulator.wait_readers("ego/front/semantic", 1);
    for _ in 0..5 {
        let tick = simulator.step(1);
        let found = simulator.result_of(&mut boxes, tick);
        let input = &found.inputs()[0];
        let input = (input.topic(), input.tick);
        assert_eq!(input, ("ego/front/semantic".to_owned(), tick));

        // The box of the car's own pixels, from another picture of the same tick.
        let image = simulator.frame_of(&mut objects, tick);
        let width = image.header().width as usize;
        let pixels = image.elements::<u32>().expect("numbers of objects");
        let places = pixels.iter().enumerate().filter(|(_, id)| **id == car);
        let (mut low, mut high) = ([f32::MAX; 2], [0.0_f32; 2]);
        for (i, _) in places {
            let at = [(i % width) as f32, (i / width) as f32];
            low = [low[0].min(at[0]), low[1].min(at[1])];
            high = [high[0].max(at[0] + 1.0), high[1].max(at[1] + 1.0)];
        }
        let records = found.records::<Box2d>().expect("boxes");
        assert!(
            records
                .iter()
                .any(|it| it.min_px == low && it.max_px == high),
            "{low:?} to {high:?} is not in {records:?}"
        );
    }
    drop((boxes, objects));
    program.stop().expect_code(0);
    simulator.finish();
}
