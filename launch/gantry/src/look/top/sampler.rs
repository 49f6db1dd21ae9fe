//! Collects a [`View`]: who is there, how busy they are, and what their topics do.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use launch_cli::wrong_usage;
use nix::sys::statvfs::statvfs;
use schema_bus::names::WORLD_SNAPSHOT;
use schema_bus::{Bus, Watch, mono_now};
use sysinfo::{Pid, ProcessRefreshKind, ProcessStatus, ProcessesToUpdate, System};

use super::history::Track;
use super::measure::Measurer;
use super::stages::Stages;
use super::view::{Measured, ProcessRow, SharedMemory, TopicRow, View, World};
use crate::look::census::{Census, Kind, Member, Topic};

/// Rates of a topic that are remembered, one for each look.
const REMEMBERED: usize = 120;

/// Least time between two looks at who is there. Such a look makes and removes a few files of
/// iceoryx2 for every service; what the topics do in between is seen without.
const CENSUS: Duration = Duration::from_millis(900);

/// Why a topic is not measured.
#[derive(Debug, thiserror::Error)]
enum Unmeasurable {
    #[error("there is no topic {topic:?} on this domain")]
    Unknown { topic: String },
    #[error("{topic} carries requests and their answers, which only their two ends see")]
    Requests { topic: String },
    #[error(
        "{topic} has {n_readers} of {max_readers} readers; top leaves the last place to others"
    )]
    Full {
        topic: String,
        n_readers: usize,
        max_readers: usize,
    },
    #[error("nobody reads {topic}, so its sensor rests; M measures it all the same")]
    Rests { topic: String },
}

/// Looks at the bus and the machine again and again.
pub struct Sampler {
    bus: Bus,
    watch: Watch,
    system: System,
    measurer: Option<Measurer>,
    census: Census,
    /// By the number of the writer's port.
    tracks: BTreeMap<u128, Track>,
    /// By topic.
    rates: BTreeMap<String, VecDeque<f64>>,
    looked: Instant,
    counted: Instant,
    stages: Stages,
}

impl Sampler {
    /// Joins the domain and looks for the first time.
    pub fn new(domain: &str) -> anyhow::Result<Sampler> {
        let bus = Bus::open(domain, "gantry-top")?;
        let watch = bus.watch();
        let mut sampler = Sampler {
            bus,
            watch,
            system: System::new(),
            measurer: None,
            census: Census::default(),
            tracks: BTreeMap::new(),
            rates: BTreeMap::new(),
            looked: Instant::now(),
            counted: Instant::now(),
            stages: Stages::default(),
        };
        sampler.take_census()?;
        let tick = sampler.world(mono_now().0).map(|world| world.tick);
        let mut processes = sampler.processes();
        sampler.stages.look(&mut processes, tick);
        Ok(sampler)
    }

    /// Notes new samples; cheap enough for every 10 ms.
    pub fn glance(&mut self) {
        self.watch.look();
        self.note();
    }

    /// Looks at everything and says what there is.
    pub fn look(&mut self) -> anyhow::Result<View> {
        if self.counted.elapsed() >= CENSUS {
            self.take_census()?;
        } else {
            self.glance();
            self.measure_load();
        }
        let interval_secs = self.looked.elapsed().as_secs_f64();
        self.looked = Instant::now();
        let now = mono_now().0;
        let mut figures = self
            .measurer
            .as_ref()
            .map(Measurer::figures)
            .unwrap_or_default();
        let topics: Vec<TopicRow> = self
            .census
            .topics
            .iter()
            .map(|topic| row(&self.tracks, topic, now, figures.remove(&topic.name)))
            .collect();
        let topics = topics.into_iter().map(|row| self.remember(row)).collect();
        let world = self.world(now);
        let mut processes = self.processes();
        self.stages
            .look(&mut processes, world.map(|world| world.tick));
        Ok(View {
            domain: self.census.domain.clone(),
            interval_secs,
            world,
            shared_memory: shared_memory(),
            processes,
            topics,
        })
    }

    /// Begins to read a topic, or gives its place back. Returns a sentence for the screen.
    pub fn toggle_measuring(
        &mut self,
        topic: &str,
        even_if_unread: bool,
    ) -> anyhow::Result<String> {
        if let Some(measurer) = self.measurer.as_ref().filter(|it| it.has(topic)) {
            measurer.remove(topic);
            return Ok(format!("{topic} is read no more"));
        }
        if let Err(reason) = self.may_measure(topic, even_if_unread) {
            return Ok(reason.to_string());
        }
        self.begin(topic)?;
        Ok(format!(
            "reading {topic} for its losses, jitter and delay; m ends it"
        ))
    }

    /// Begins to read a topic, also one that nobody reads.
    ///
    /// # Errors
    /// A sentence if there is no such topic, or only one free place for readers.
    pub fn measure(&mut self, topic: &str) -> anyhow::Result<()> {
        self.may_measure(topic, true).map_err(wrong_usage)?;
        self.begin(topic)
    }

    fn begin(&mut self, topic: &str) -> anyhow::Result<()> {
        let measurer = match self.measurer.take() {
            Some(measurer) => measurer,
            None => Measurer::start(self.bus.domain())?,
        };
        measurer.add(topic);
        self.measurer = Some(measurer);
        Ok(())
    }

    /// A topic's last free place is left to others, and one that nobody reads costs nothing today.
    fn may_measure(&self, topic: &str, even_if_unread: bool) -> Result<(), Unmeasurable> {
        let (known, topic) = (self.census.topic(topic), topic.to_owned());
        let Some(known) = known else {
            return Err(Unmeasurable::Unknown { topic });
        };
        let service = &known.service;
        if known.kind == Kind::Requests {
            return Err(Unmeasurable::Requests { topic });
        }
        if known.free_places() < 2 {
            return Err(Unmeasurable::Full {
                topic,
                n_readers: service.readers.len(),
                max_readers: service.max_readers,
            });
        }
        if service.readers.is_empty() && known.kind == Kind::Frames && !even_if_unread {
            return Err(Unmeasurable::Rests { topic });
        }
        Ok(())
    }

    fn take_census(&mut self) -> anyhow::Result<()> {
        // Otherwise ports of killed processes would be shown as alive.
        self.bus.clean_dead_nodes();
        self.census = Census::take(&self.bus)?;
        let services = self.census.topics.iter().map(|topic| topic.service.clone());
        self.watch.follow(&services.collect::<Vec<_>>());
        let alive = |id: &u128| {
            let mut ports = self
                .census
                .topics
                .iter()
                .flat_map(|topic| &topic.service.writers);
            ports.any(|port| port.id == *id)
        };
        self.tracks.retain(|id, _| alive(id));
        self.rates
            .retain(|name, _| self.census.topic(name).is_some());
        self.note();
        self.measure_load();
        self.counted = Instant::now();
        Ok(())
    }

    /// Asks the kernel for load and memory of the processes.
    fn measure_load(&mut self) {
        let pids: Vec<Pid> = self
            .census
            .processes
            .iter()
            .filter_map(|process| process.pid.map(Pid::from_u32))
            .collect();
        let what = ProcessRefreshKind::nothing()
            .with_cpu()
            .with_memory()
            .without_tasks();
        self.system
            .refresh_processes_specifics(ProcessesToUpdate::Some(&pids), true, what);
    }

    fn note(&mut self) {
        let now = mono_now().0;
        for port in self
            .census
            .topics
            .iter()
            .flat_map(|topic| &topic.service.writers)
        {
            if let Some(sample) = self.watch.newest(port.id) {
                self.tracks.entry(port.id).or_default().see(sample, now);
            }
        }
    }

    fn remember(&mut self, mut row: TopicRow) -> TopicRow {
        let rates = self.rates.entry(row.topic.clone()).or_default();
        rates.push_back(row.rate_hz.unwrap_or(0.0));
        while rates.len() > REMEMBERED {
            rates.pop_front();
        }
        row.rate_history = rates.iter().copied().collect();
        row
    }

    fn world(&self, now: u64) -> Option<World> {
        let topic = self.census.topic(WORLD_SNAPSHOT)?;
        let track = topic
            .service
            .writers
            .iter()
            .find_map(|port| self.tracks.get(&port.id))?;
        let newest = track.newest()?;
        Some(World {
            tick: newest.tick,
            sim_secs: newest.sim_nanos? as f64 / 1e9,
            speed: track.speed(now),
        })
    }

    fn processes(&self) -> Vec<ProcessRow> {
        let of = |ends: fn(&Topic) -> &Vec<Member>, pid: Option<u32>| {
            let topics = self.census.topics.iter();
            let has = |topic: &&Topic| ends(topic).iter().any(|member| member.pid == pid);
            topics.filter(has).map(|topic| topic.name.clone()).collect()
        };
        let row = |process: &Member| {
            let pid = process.pid?;
            let known = self.system.process(Pid::from_u32(pid));
            Some(ProcessRow {
                pid,
                name: process.name.clone(),
                cpu_percent: known.map(|known| known.cpu_usage()),
                resident_bytes: known.map(|known| known.memory()),
                uptime_secs: known.map(|known| known.run_time()),
                stopped: known.is_some_and(|known| {
                    matches!(known.status(), ProcessStatus::Stop | ProcessStatus::Tracing)
                }),
                writes: of(|topic| &topic.writers, process.pid),
                reads: of(|topic| &topic.readers, process.pid),
                stages: Vec::new(),
            })
        };
        self.census.processes.iter().filter_map(row).collect()
    }
}

/// The figures of a topic: sums over its writers, of which the newest sample counts.
fn row(
    tracks: &BTreeMap<u128, Track>,
    topic: &Topic,
    now: u64,
    measured: Option<Measured>,
) -> TopicRow {
    let service = &topic.service;
    let of_writers = || {
        service
            .writers
            .iter()
            .filter_map(|port| tracks.get(&port.id))
    };
    let sum = |values: Vec<f64>| (!values.is_empty()).then(|| values.iter().sum());
    let newest = of_writers()
        .filter_map(Track::newest)
        .max_by_key(|sample| (sample.published_mono_nanos, sample.seq));
    let published = newest.and_then(|sample| sample.published_mono_nanos);
    let origin = newest.and_then(|sample| sample.origin_mono_nanos);
    let bytes = |track: &Track| Some(track.rate_hz(now)? * track.mean_bytes()?);
    TopicRow {
        topic: topic.name.clone(),
        kind: topic.kind,
        type_name: topic.type_name.clone(),
        rate_hz: sum(of_writers()
            .filter_map(|track| track.rate_hz(now))
            .collect()),
        age_nanos: published.map(|published| now.saturating_sub(published)),
        since_sensor_nanos: published
            .zip(origin)
            .map(|(published, origin)| published.saturating_sub(origin)),
        bytes_per_sec: sum(of_writers().filter_map(bytes).collect()),
        payload_bytes: newest.map(|sample| sample.payload_bytes),
        max_payload_bytes: topic.max_payload_bytes(),
        seq: newest.map(|sample| sample.seq),
        tick: newest.map(|sample| sample.tick),
        writers: topic.writers.clone(),
        readers: topic.readers.clone(),
        n_readers: service.readers.len(),
        max_readers: service.max_readers,
        measured,
        rate_history: Vec::new(),
    }
}

fn shared_memory() -> SharedMemory {
    let Ok(stat) = statvfs("/dev/shm") else {
        return SharedMemory::default();
    };
    SharedMemory {
        size_bytes: stat.blocks() * stat.fragment_size(),
        free_bytes: stat.blocks_available() * stat.fragment_size(),
    }
}
