//! Actors from near by: `close_ups OUT_DIR [low|high] [WEATHER]` writes sheets of vehicles, open
//! doors and walkers.
//!
//! Each actor stands on a street of Town10HD and is shown from its front left corner; doors also
//! from behind and from afar.

use std::path::Path;

use anyhow::{Context as _, bail};
use nalgebra::{Isometry3, Point3, Vector3};
use schema_frames::document::PoseText;
use schema_frames::{Command, CommandReply, Modality, WalkerControl};
use schema_types::{ActorId, Pose};
use sensor_camera::{CameraRenderer, Output, Place, Quality, View, ViewJob, ViewSpec};
use sensor_gpu::{Gpu, GpuOptions};
use sensor_spec::Intrinsics;
use test_render::sheet::Picture;
use test_render::{Stage, weathers};

const SIZE_PX: [u32; 2] = [640, 480];
/// Index of the spawn point where actors stand; there are houses behind it.
const SPOT: usize = 57;

const VEHICLES: [&str; 20] = [
    "tesla.model3",
    "dodge.charger_police",
    "ford.crown",
    "mini.cooper_s",
    "micro.microlino",
    "audi.etron",
    "jeep.wrangler_rubicon",
    "mercedes.sprinter",
    "volkswagen.t2",
    "ford.ambulance",
    "tesla.cybertruck",
    "carlamotors.european_hgv",
    "carlamotors.firetruck",
    "carlamotors.carlacola",
    "mitsubishi.fusorosa",
    "harley-davidson.low_rider",
    "kawasaki.ninja",
    "vespa.zx125",
    "bh.crossbike",
    "gazelle.omafiets",
];
const WITH_DOORS: [&str; 4] = [
    "lincoln.mkz_2020",
    "mini.cooper_s_2021",
    "nissan.patrol_2021",
    "mercedes.sprinter",
];
const WALKERS: [u32; 12] = [1, 5, 9, 12, 15, 20, 26, 30, 35, 40, 48, 52];

struct Studio {
    gpu: Gpu,
    renderer: CameraRenderer,
    stage: Stage,
    weather: String,
}

impl Studio {
    fn spawn(&mut self, type_id: &str, up_m: f64, settle: usize) -> anyhow::Result<ActorId> {
        let pose = self.stage.places[SPOT] * Isometry3::translation(0.0, 0.0, up_m);
        let command = Command::Spawn {
            type_id: type_id.into(),
            pose: PoseText::from(Pose::from(pose)),
            parent_id: None,
            role: String::new(),
            attributes: Default::default(),
        };
        let CommandReply::Spawned { actor_id, .. } = self.stage.apply(&command)? else {
            bail!("{type_id} did not appear");
        };
        (0..settle).for_each(|_| self.stage.step());
        Ok(ActorId(actor_id))
    }

    fn destroy(&mut self, actor: ActorId) -> anyhow::Result<()> {
        self.stage
            .apply(&Command::Destroy { actor_id: actor.0 })
            .map(|_| ())
    }

    /// Renders from a place in the actor's space towards another.
    fn shoot(
        &mut self,
        actor: ActorId,
        eye: [f64; 3],
        target: [f64; 3],
        fov_deg: f64,
    ) -> anyhow::Result<Picture> {
        let weather = weathers::named(&self.weather)
            .with_context(|| format!("weather is none of {}", weathers::NAMES.join(", ")))?;
        let lens = Intrinsics::from_fov(SIZE_PX[0], SIZE_PX[1], fov_deg.to_radians());
        let mut view = View::new(&self.gpu, ViewSpec::pinhole(lens));
        let mut bytes = vec![0; view.payload_bytes(Modality::Rgb)];
        let away = Point3::from(target) - Point3::from(eye);
        let look = Vector3::new(
            0.0,
            -away.z.atan2(away.x.hypot(away.y)),
            away.y.atan2(away.x),
        );
        let turn = nalgebra::UnitQuaternion::from_euler_angles(0.0, look.y, look.z);
        let actor_pose = self
            .stage
            .world()
            .record(actor)
            .context("it is gone")?
            .world_from_actor
            .isometry();
        let world_from_sensor = actor_pose * Isometry3::from_parts(Vector3::from(eye).into(), turn);
        let outputs = vec![Output {
            modality: Modality::Rgb,
            place: Place::Memory(&mut bytes),
        }];
        let job = ViewJob {
            view: &mut view,
            world_from_sensor,
            outputs,
        };
        let submission = self
            .renderer
            .render(&self.stage.scene(weather), vec![job])?;
        submission.wait()?;
        Ok(Picture::of(Modality::Rgb, SIZE_PX.map(|side| side as usize), &bytes).shrunk(2))
    }

    fn vehicles(&mut self) -> anyhow::Result<Picture> {
        let mut tiles = Vec::new();
        for name in VEHICLES {
            let car = self.spawn(&format!("vehicle.{name}"), 0.3, 30)?;
            let lamps = if self.weather.contains("night") {
                0b11_0000_0011
            } else {
                0
            };
            self.stage.set_lamps(lamps);
            let [x, y, z] = self
                .stage
                .world()
                .record(car)
                .context("it is gone")?
                .half_box_m
                .map(f64::from);
            tiles.push(self.shoot(
                car,
                [x + 2.2 + 0.3 * x, y + 1.6 + 0.5 * x, 1.1 + 0.5 * z],
                [0.0, 0.0, 0.9 * z],
                60.0,
            )?);
            self.destroy(car)?;
        }
        Ok(Picture::sheet(&tiles, 4))
    }

    fn doors(&mut self) -> anyhow::Result<Picture> {
        let mut tiles = Vec::new();
        for name in WITH_DOORS {
            let car = self.spawn(&format!("vehicle.{name}"), 0.3, 20)?;
            self.stage.apply(&Command::SetDoors {
                actor_id: car.0,
                doors: 15,
                open: true,
            })?;
            (0..30).for_each(|_| self.stage.step());
            let [x, ..] = self
                .stage
                .world()
                .record(car)
                .context("it is gone")?
                .half_box_m
                .map(f64::from);
            tiles.push(self.shoot(car, [x + 1.2, 4.4, 1.6], [0.0, 0.3, 0.8], 65.0)?);
            tiles.push(self.shoot(car, [-x - 1.0, 4.0, 1.7], [0.2, 0.3, 0.8], 65.0)?);
            tiles.push(self.shoot(car, [0.4, -4.2, 1.5], [0.2, 0.0, 0.8], 65.0)?);
            tiles.push(self.shoot(car, [20.0, 6.0, 1.8], [0.0, 0.0, 0.8], 16.0)?);
            self.destroy(car)?;
        }
        Ok(Picture::sheet(&tiles, 4))
    }

    fn walkers(&mut self) -> anyhow::Result<Picture> {
        let mut tiles = Vec::new();
        let ahead: [f32; 3] = (self.stage.places[SPOT].rotation * Vector3::x())
            .cast::<f32>()
            .into();
        for (numbers, speed_mps) in [
            (&WALKERS[..6], 0.0),
            (&WALKERS[6..], 0.0),
            (&WALKERS[..6], 1.4),
            (&WALKERS[6..], 1.4),
        ] {
            for (i, number) in numbers.iter().enumerate() {
                let walker = self.spawn(&format!("walker.pedestrian.{number:04}"), 1.0, 20)?;
                let control = WalkerControl {
                    direction: ahead,
                    speed_mps,
                    jump: false,
                };
                self.stage.apply(&Command::ControlWalker {
                    actor_id: walker.0,
                    control,
                })?;
                // Each in another phase of its gait.
                (0..20 + 2 * i).for_each(|_| self.stage.step());
                let tall_m = 2.0
                    * f64::from(
                        self.stage
                            .world()
                            .record(walker)
                            .context("it is gone")?
                            .half_box_m[2],
                    );
                tiles.push(self.shoot(walker, [2.3, 1.1, 0.25 * tall_m], [0.0, 0.0, 0.0], 52.0)?);
                self.destroy(walker)?;
            }
        }
        Ok(Picture::sheet(&tiles, 6))
    }
}

fn run() -> anyhow::Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [folder, rest @ ..] = words.as_slice() else {
        bail!("say close_ups OUT_DIR [low|high] [WEATHER]");
    };
    let quality = match rest.first().map(String::as_str) {
        Some("low") => Quality::Low,
        None | Some("high") => Quality::High,
        Some(other) => bail!("quality is {other:?}, but must be low or high"),
    };
    let folder = Path::new(folder);
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let gpu = Gpu::open(&GpuOptions::default())?;
    let weather = rest.get(1).cloned().unwrap_or_else(|| "day".into());
    let mut studio = Studio {
        renderer: CameraRenderer::new(&gpu, quality),
        gpu,
        stage: Stage::new("Town10HD", 7, 0)?,
        weather,
    };
    studio
        .vehicles()?
        .write_jpeg(&folder.join("vehicles.jpg"))?;
    studio.doors()?.write_jpeg(&folder.join("doors.jpg"))?;
    studio.walkers()?.write_jpeg(&folder.join("walkers.jpg"))
}

fn main() {
    if let Err(error) = run() {
        eprintln!("{error:#}");
        std::process::exit(2);
    }
}
