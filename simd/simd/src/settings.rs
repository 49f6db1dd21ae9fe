//! What this run is asked to do: command line and launch file, resolved once.

pub mod cli;

use std::path::PathBuf;
use std::sync::Arc;

use launch_cli::wrong_usage;
use launch_spec::{FileText, Launch, LidarsOn};
use schema_frames::Seal;
use sensor_camera::Quality;
use sensor_gpu::{CopyPath, Gpu, GpuOptions};
use sensor_ray::GpuRays;

use cli::{Args, LidarsOnArg, OnLostClient, QualityArg};
use simd_frames::topic::{Audience, FrameOptions, Transfer, Writer};

/// What is simulated without a launch file.
const DEFAULT_LAUNCH: &str = "version = 1\n[scenario]\nvehicles = 20\n";

/// Settings of a run. Flags have overridden the launch file already.
pub struct Settings {
    /// The checked launch file.
    pub launch: Launch,
    /// Folder of the launch file, in which relative paths of maps are looked for.
    pub launch_folder: Option<PathBuf>,
    /// Folder for maps and checkpoints.
    pub data_folder: PathBuf,
    /// First part of every topic name.
    pub domain: String,
    /// Which GPU, and how it copies; `None` opens none.
    pub gpu: Option<GpuOptions>,
    /// Most bytes of the GPU's memory for the images of cameras; `None` leaves it to the driver.
    pub gpu_memory_bytes: Option<u64>,
    /// File whose appearance ends the GPU, in tests.
    pub lose_gpu_when: Option<std::path::PathBuf>,
    /// Quality of colour; `None` chooses by adapter.
    pub quality: Option<Quality>,
    /// What casts lidars, and which setting says so.
    lidars_on: LidarsOn,
    lidars_on_source: &'static str,
    /// Ticks that a camera's frame may stay on the GPU.
    pub frames_in_flight: u32,
    /// How the GPU's frames get into shared memory.
    pub transfer: Transfer,
    /// Which topics get frames.
    pub audience: Audience,
    /// When the daemon stops, and what it waits for.
    pub run: RunSettings,
    /// Names of lockstep participants that the first tick waits for.
    pub awaited_participants: Vec<String>,
    /// Journal to run again.
    pub journal: Option<PathBuf>,
    /// Simulated time up to which it holds, nanoseconds.
    pub journal_until_nanos: Option<u64>,
    /// Sensors with ids of a range of their own.
    pub added_sensors: Vec<String>,
    /// Most memory for the journal that is kept.
    pub journal_bytes: usize,
    /// What is shown of the world, if programs are scored against it.
    pub seal: Option<Arc<Seal>>,
}

/// Settings of the tick loop.
#[derive(Clone, Copy, Debug)]
pub struct RunSettings {
    /// Tick after which the daemon stops.
    pub last_tick: Option<u64>,
    /// Whether free-running ticks keep real time.
    pub speed: Speed,
    /// Whether cameras and lidars fire less often where real time is not kept.
    pub keep_up: bool,
    /// What stepped mode does without a client.
    pub on_lost_client: OnLostClient,
    /// Idle time after which a living lockstep participant is removed.
    pub lockstep_timeout_nanos: Option<u64>,
    /// Lockstep participants that the first tick waits for.
    pub n_awaited_participants: usize,
    /// Render workers that the first tick waits for.
    pub n_awaited_workers: usize,
}

/// How fast free-running ticks follow one another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Speed {
    /// One period apart.
    RealTime,
    /// As fast as possible (`--unpaced`).
    Unpaced,
}

impl Settings {
    /// Reads and checks the launch file and lays the flags over it.
    pub fn resolve(args: &Args) -> anyhow::Result<Settings> {
        let launch = read_launch(args)?;
        if let Some(name) = args
            .added_sensor
            .iter()
            .find(|name| !launch.sensors.contains_key(*name))
        {
            return Err(wrong_usage(format!(
                "--added-sensor {name}: the launch file has no sensor of this name"
            )));
        }
        let (lidars_on, lidars_on_source) = match args.lidars_on {
            Some(LidarsOnArg::Cpu) => (LidarsOn::Cpu, "--lidars-on cpu"),
            Some(LidarsOnArg::Gpu) => (LidarsOn::Gpu, "--lidars-on gpu"),
            None => (launch.scenario.lidars_on, "scenario.lidars_on = \"gpu\""),
        };
        let lockstep_timeout_nanos = launch.scenario.lockstep_timeout_nanos();
        Ok(Settings {
            launch,
            launch_folder: args
                .launch
                .as_deref()
                .and_then(std::path::Path::parent)
                .map(Into::into),
            data_folder: launch_cli::data_dir(args.data.as_deref())?,
            domain: args.common.domain.clone(),
            gpu: (!args.no_gpu).then(|| GpuOptions {
                adapter: args.adapter.clone(),
                allow_import: !args.staged,
                copies: if args.one_queue {
                    CopyPath::Behind
                } else {
                    CopyPath::Beside
                },
            }),
            gpu_memory_bytes: args.gpu_memory.map(|mebibytes| u64::from(mebibytes) << 20),
            lose_gpu_when: args.lose_gpu_when.clone(),
            quality: args.quality.map(|quality| match quality {
                QualityArg::Low => Quality::Low,
                QualityArg::High => Quality::High,
            }),
            lidars_on,
            lidars_on_source,
            frames_in_flight: args.frames_in_flight,
            transfer: if args.staged {
                Transfer::Staged
            } else {
                Transfer::Imported
            },
            audience: if args.hash {
                Audience::Hash
            } else {
                Audience::Readers
            },
            run: RunSettings {
                last_tick: args.ticks,
                speed: if args.unpaced {
                    Speed::Unpaced
                } else {
                    Speed::RealTime
                },
                keep_up: args.keep_up,
                on_lost_client: args.on_lost_client,
                lockstep_timeout_nanos: args
                    .lockstep_timeout
                    .map(|secs| u64::from(secs) * 1_000_000_000)
                    .or(lockstep_timeout_nanos),
                n_awaited_participants: args.await_lockstep as usize,
                n_awaited_workers: args.await_workers as usize,
            },
            awaited_participants: args.await_participant.clone(),
            journal: args.journal.clone(),
            journal_until_nanos: args.journal_until,
            added_sensors: args.added_sensor.clone(),
            journal_bytes: (args.journal_mb as usize) << 20,
            seal: args.sealed.clone().map(Arc::new),
        })
    }

    /// How frames are made on `gpu`.
    ///
    /// # Errors
    /// If `gpu` is asked to cast lidars, but cannot.
    pub fn frame_options(&self, gpu: Option<&Gpu>) -> anyhow::Result<FrameOptions> {
        Ok(FrameOptions {
            frames_in_flight: self.frames_in_flight,
            transfer: self.transfer,
            lidars_on: self.lidars_on(gpu)?,
            audience: self.audience,
            seal: self.seal.clone(),
        })
    }

    /// What casts the lidars: what the command line or else the launch file asks for, else `gpu` if
    /// it is a real one that can.
    fn lidars_on(&self, gpu: Option<&Gpu>) -> anyhow::Result<Writer> {
        let Some(gpu) = gpu else {
            if self.lidars_on == LidarsOn::Gpu {
                return Err(wrong_usage(format!(
                    "{}, but with --no-gpu there is none; say cpu",
                    self.lidars_on_source
                )));
            }
            return Ok(Writer::Cpu);
        };
        let missing = GpuRays::missing(gpu);
        let chosen = match self.lidars_on {
            LidarsOn::Gpu => Writer::Gpu,
            LidarsOn::Cpu => Writer::Cpu,
            LidarsOn::Auto if missing.is_none() && !gpu.is_software() => Writer::Gpu,
            LidarsOn::Auto => Writer::Cpu,
        };
        if let Some(missing) = missing {
            if chosen == Writer::Gpu {
                return Err(wrong_usage(format!(
                    "{}: {missing}; say cpu, or choose another --adapter",
                    self.lidars_on_source
                )));
            }
            if !gpu.is_software() {
                tracing::info!(missing, "lidars are cast on the CPU");
            }
        }
        Ok(chosen)
    }
}

/// Name of the GPU that this process renders on.
pub fn adapter_of(gpu: Option<&Gpu>) -> &str {
    gpu.map_or("none", Gpu::name)
}

/// Reads and checks the launch file; without one, the built-in defaults.
fn read_launch(args: &Args) -> anyhow::Result<Launch> {
    // The last word counts, so `--map` comes after every `--set`.
    let map = args
        .map
        .iter()
        .map(|map| format!("scenario.map={}", toml_text(map)));
    let set: Vec<String> = args.set.iter().cloned().chain(map).collect();
    match &args.launch {
        Some(path) => Launch::load(std::slice::from_ref(path), &set, &mut FileText::read),
        None => Launch::parse_with(DEFAULT_LAUNCH, "built-in defaults", &set),
    }
    .map_err(wrong_usage)
}

/// A text as TOML writes it.
fn toml_text(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}
