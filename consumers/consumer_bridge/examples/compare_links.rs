//! Latency and throughput of frames through two bridges, beside zenoh alone and TCP alone with the
//! same bytes, in turns of one run over the loopback.
//!
//! Usage: `compare_links [ROUNDS] [--json FILE]`. Each line is one turn: paced at 20 frames a second, then as fast
//! as it goes.

use std::collections::HashMap;
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::process::ExitCode;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use consumer_bridge::bridge::bridge;
use consumer_bridge::options::Options;
use launch_cli::Shutdown;
use launch_cli::bench::{self, BenchResult, Samples, clap};
use schema_bus::{Bus, FramePublisher, FrameReader, FrameTopic, LoanError};
use schema_frames::Modality;
use zenoh::Wait as _;
use zenoh::qos::CongestionControl;

/// Sizes of images, pixels.
const SIZES: [(u32, u32); 3] = [(64, 48), (800, 600), (1920, 1080)];
/// Frames of a paced turn.
const PACED: u64 = 60;
/// Pause between two of them.
const PAUSE: Duration = Duration::from_millis(50);
/// Length of a turn as fast as it goes.
const FAST: Duration = Duration::from_secs(2);
const TOPIC: &str = "ego/front/rgb";

/// A way over which payloads go.
trait Way {
    /// Sends a payload with the number `seq`; `false` if it was not taken now.
    fn send(&mut self, seq: u64, payload: &[u8]) -> bool;
    /// Number of the next payload that arrived, and when.
    fn receive(&mut self, wait: Duration) -> Option<(u64, Instant)>;
}

/// Compares two bridges with zenoh and TCP alone
#[derive(Debug, clap::Args)]
struct Args {
    #[arg(default_value_t = 3)]
    rounds: u32,
}

fn main() -> ExitCode {
    bench::run("compare_links", measure_all)
}

fn measure_all(args: &Args, result: &mut BenchResult) -> anyhow::Result<()> {
    println!("way      size_px    round  sent  got   p50_ms  p99_ms  max_ms   fast_mb_s  fast_hz");
    for round in 1..=args.rounds {
        for (width, height) in SIZES {
            let payload: Vec<u8> = (0..width * height * 4)
                .map(|n| (n.wrapping_mul(2_654_435_761) >> 24) as u8)
                .collect();
            let mut ways: [(&str, Box<dyn Way>); 3] = [
                ("bridge", Box::new(Bridged::open(width, height)?)),
                ("zenoh", Box::new(Plain::open()?)),
                ("tcp", Box::new(Tcp::open()?)),
            ];
            for (name, way) in &mut ways {
                measure(name, (width, height), round, way.as_mut(), &payload, result);
            }
        }
    }
    Ok(())
}

fn measure(
    name: &str,
    (width, height): (u32, u32),
    round: u32,
    way: &mut dyn Way,
    payload: &[u8],
    result: &mut BenchResult,
) {
    // Until the other end listens.
    let mut seq = 0;
    let began = Instant::now();
    while began.elapsed() < Duration::from_secs(30) {
        seq += 1;
        way.send(seq, payload);
        if way.receive(Duration::from_millis(50)).is_some() {
            break;
        }
    }
    while way.receive(Duration::from_millis(200)).is_some() {}
    let (mut delays_ms, mut sent) = (Vec::new(), HashMap::new());
    let mut note = |way: &mut dyn Way, sent: &HashMap<u64, Instant>, wait: Duration| {
        let arrived = way.receive(wait);
        if let Some((got, at)) = arrived
            && let Some(sent) = sent.get(&got)
        {
            delays_ms.push((at - *sent).as_secs_f64() * 1e3);
        }
        arrived.is_some()
    };
    for _ in 0..PACED {
        seq += 1;
        let now = Instant::now();
        sent.insert(seq, now);
        way.send(seq, payload);
        while note(way, &sent, PAUSE.saturating_sub(now.elapsed())) {}
    }
    while note(way, &sent, Duration::from_millis(300)) {}
    let n_got = delays_ms.len();
    let delays_ms: Samples = delays_ms.into_iter().collect();
    let [p50, p99, max] = [0.5, 0.99, 1.0].map(|share| delays_ms.at(share));
    let began = Instant::now();
    let mut n_fast = 0u64;
    while began.elapsed() < FAST {
        seq += 1;
        way.send(seq, payload);
        while way.receive(Duration::ZERO).is_some() {
            n_fast += 1;
        }
    }
    let hz = n_fast as f64 / began.elapsed().as_secs_f64();
    println!(
        "{name:8} {:10} {round:5} {PACED:5} {n_got:4} {p50:8.2} {p99:7.2} {max:7.2} {:10.0} {hz:9.1}",
        format!("{width}x{height}"),
        hz * payload.len() as f64 / 1e6,
    );
    let figures = [
        ("round", f64::from(round)),
        ("p50_ms", p50),
        ("p99_ms", p99),
        ("max_ms", max),
        ("fast_hz", hz),
    ];
    result.row(&format!("{name}, {width}x{height}"), &figures);
    while way.receive(Duration::from_millis(300)).is_some() {}
}

fn free_port() -> anyhow::Result<u16> {
    Ok(TcpListener::bind("127.0.0.1:0")?.local_addr()?.port())
}

/// A publisher on one domain, a reader on another, two bridges between.
struct Bridged {
    publisher: FramePublisher,
    wake: schema_bus::Notifier,
    reader: FrameReader,
    listener: schema_bus::Listener,
    size_px: (u32, u32),
    _buses: [Bus; 2],
}

impl Bridged {
    fn open(width: u32, height: u32) -> anyhow::Result<Bridged> {
        let port = free_port()?;
        let endpoint = format!("tcp/127.0.0.1:{port}");
        let domains = ["near", "far"].map(|end| format!("cmp-{end}-{port}"));
        let buses = [
            Bus::open(&domains[0], "compare")?,
            Bus::open(&domains[1], "compare")?,
        ];
        let spec = FrameTopic::new(Modality::Rgb, (width * height * 4) as usize);
        let publisher = buses[0].frame_publisher(TOPIC, spec)?;
        let wake = buses[0].notifier(TOPIC)?;
        let mut near = Options::new(&domains[0]);
        near.listen = vec![endpoint.clone()];
        let mut far = Options::new(&domains[1]);
        far.connect = vec![endpoint];
        for options in [near, far] {
            std::thread::spawn(move || {
                let shutdown = Shutdown::install().expect("signals can be handled");
                bridge(&options, &shutdown).map(drop)
            });
        }
        let began = Instant::now();
        let reader = loop {
            match buses[1].frame_reader(TOPIC) {
                Ok(reader) => break reader,
                Err(error) if began.elapsed() > Duration::from_secs(30) => {
                    return Err(error).context("the topic does not cross");
                }
                Err(_) => std::thread::sleep(Duration::from_millis(20)),
            }
        };
        Ok(Bridged {
            publisher,
            wake,
            listener: buses[1].listener(TOPIC)?,
            reader,
            size_px: (width, height),
            _buses: buses,
        })
    }
}

impl Way for Bridged {
    fn send(&mut self, seq: u64, payload: &[u8]) -> bool {
        let mut loan = match self.publisher.loan(payload.len()) {
            Ok(loan) => loan,
            Err(LoanError::NoFreeSlot { .. }) => return false,
            Err(error) => panic!("{error}"),
        };
        loan.payload_mut().copy_from_slice(payload);
        loan.header_mut().set_image(self.size_px.0, self.size_px.1);
        loan.header_mut().seq = seq;
        loan.send().expect("the bus takes frames");
        self.wake.notify_listeners();
        true
    }

    fn receive(&mut self, wait: Duration) -> Option<(u64, Instant)> {
        let deadline = Instant::now() + wait;
        loop {
            if let Some(frame) = self.reader.next().expect("frames are good") {
                return Some((frame.header().seq, Instant::now()));
            }
            let rest = deadline.saturating_duration_since(Instant::now());
            if rest.is_zero() {
                return None;
            }
            self.listener.wait(rest).expect("the event is there");
        }
    }
}

/// zenoh alone: one publisher, one subscriber, reliable and blocking as the bridge's.
struct Plain {
    publisher: zenoh::pubsub::Publisher<'static>,
    arrived: Receiver<(u64, Instant)>,
    _subscriber: zenoh::pubsub::Subscriber<()>,
    _sessions: [zenoh::Session; 2],
}

impl Plain {
    fn open() -> anyhow::Result<Plain> {
        let endpoint = format!("[\"tcp/127.0.0.1:{}\"]", free_port()?);
        let open = |listen: &str, connect: &str| {
            let mut config = zenoh::Config::default();
            for (key, value) in [
                ("scouting/multicast/enabled", "false"),
                ("listen/endpoints", listen),
                ("connect/endpoints", connect),
            ] {
                config
                    .insert_json5(key, value)
                    .map_err(|error| anyhow::anyhow!("{error}"))?;
            }
            zenoh::open(config)
                .wait()
                .map_err(|error| anyhow::anyhow!("{error}"))
        };
        let sessions = [open(&endpoint, "[]")?, open("[]", &endpoint)?];
        let (to, arrived) = channel();
        let subscriber = sessions[1]
            .declare_subscriber("compare/image")
            .callback(move |sample| {
                let bytes = sample.payload().to_bytes();
                let mut seq = [0; 8];
                seq.copy_from_slice(&bytes[..8]);
                let _ = to.send((u64::from_le_bytes(seq), Instant::now()));
            })
            .wait()
            .map_err(|error| anyhow::anyhow!("{error}"))?;
        let publisher = sessions[0]
            .declare_publisher("compare/image")
            .congestion_control(CongestionControl::Block)
            .wait()
            .map_err(|error| anyhow::anyhow!("{error}"))?;
        Ok(Plain {
            publisher,
            arrived,
            _subscriber: subscriber,
            _sessions: sessions,
        })
    }
}

impl Way for Plain {
    fn send(&mut self, seq: u64, payload: &[u8]) -> bool {
        let mut bytes = payload.to_vec();
        bytes[..8].copy_from_slice(&seq.to_le_bytes());
        self.publisher.put(bytes).wait().is_ok()
    }

    fn receive(&mut self, wait: Duration) -> Option<(u64, Instant)> {
        self.arrived.recv_timeout(wait).ok()
    }
}

/// TCP alone: length, payload, and a thread that reads whole payloads.
struct Tcp {
    stream: TcpStream,
    arrived: Receiver<(u64, Instant)>,
}

impl Tcp {
    fn open() -> anyhow::Result<Tcp> {
        let listener = TcpListener::bind("127.0.0.1:0")?;
        let stream = TcpStream::connect(listener.local_addr()?)?;
        let (mut other, _) = listener.accept()?;
        stream.set_nodelay(true)?;
        let (to, arrived) = channel();
        std::thread::spawn(move || {
            let (mut length, mut bytes) = ([0; 8], Vec::new());
            while other.read_exact(&mut length).is_ok() {
                bytes.resize(u64::from_le_bytes(length) as usize, 0);
                if other.read_exact(&mut bytes).is_err() {
                    return;
                }
                let mut seq = [0; 8];
                seq.copy_from_slice(&bytes[..8]);
                let _ = to.send((u64::from_le_bytes(seq), Instant::now()));
            }
        });
        Ok(Tcp { stream, arrived })
    }
}

impl Way for Tcp {
    fn send(&mut self, seq: u64, payload: &[u8]) -> bool {
        let length = payload.len() as u64;
        self.stream.write_all(&length.to_le_bytes()).is_ok()
            && self.stream.write_all(&seq.to_le_bytes()).is_ok()
            && self.stream.write_all(&payload[8..]).is_ok()
    }

    fn receive(&mut self, wait: Duration) -> Option<(u64, Instant)> {
        self.arrived.recv_timeout(wait).ok()
    }
}
