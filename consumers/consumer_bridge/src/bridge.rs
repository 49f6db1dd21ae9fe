//! The bridge as a whole: one session, and a thread for each way.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use launch_cli::Shutdown;
use zenoh::{Session, Wait as _};

use crate::counts::{Counts, Line};
use crate::export::{Exporter, Imported};
use crate::import::Importer;
use crate::keys::Keys;
use crate::link;
use crate::lookout;
use crate::options::Options;
use crate::people::People;
use crate::ros2::Ros2;
use crate::serve::Service;

/// How often the shutdown flag is looked at.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Bridges until `shutdown`. Returns what crossed.
///
/// # Errors
/// A sentence for a link that cannot be opened, and for what going on cannot heal.
pub fn bridge(options: &Options, shutdown: &Shutdown) -> anyhow::Result<Vec<Line>> {
    let session = link::open(options)?;
    tracing::info!(
        listen = options.listen.join(", "),
        connect = options.connect.join(", "),
        network = options.network,
        domain = options.domain,
        "ready"
    );
    let counts = Counts::default();
    let bridged = run(&session, options, &counts, shutdown);
    let closed = session.close().wait();
    if let Err(error) = closed {
        tracing::debug!(%error, "the session did not close in time");
    }
    bridged.map(|()| counts.lines())
}

fn run(
    session: &Session,
    options: &Options,
    counts: &Counts,
    shutdown: &Shutdown,
) -> anyhow::Result<()> {
    let keys = Keys::new(&options.network);
    let names = Imported::default();
    let stop = Arc::new(AtomicBool::new(false));
    let mut threads = Vec::new();
    let mut spawn = |name: &str, mut turn: Box<dyn FnMut() -> anyhow::Result<()> + Send>| {
        let stop = stop.clone();
        let thread = std::thread::Builder::new()
            .name(name.into())
            .spawn(move || {
                while !stop.load(Relaxed) {
                    turn()?;
                }
                anyhow::Ok(())
            })
            .context("the system gives no thread")?;
        threads.push(thread);
        anyhow::Ok(())
    };
    let listing = lookout::list(options)?;
    let mut service = None;
    if options.direction.exports() {
        service = Some(Service::open(session, &keys, options)?);
        let mut exporter = Exporter::open(
            session,
            &keys,
            options,
            listing.clone(),
            names.clone(),
            counts.clone(),
        )?;
        spawn("export", Box::new(move || exporter.turn()))?;
    }
    if options.direction.imports() {
        let mut importer = Importer::open(session, &keys, options, names, counts.clone())?;
        spawn("import", Box::new(move || importer.turn()))?;
    }
    if let Some(ros2) = &options.ros2 {
        let mut ros2 = Ros2::open(session, options, ros2, listing.clone())?;
        spawn("ros2", Box::new(move || ros2.turn()))?;
    }
    if let Some(address) = options.foxglove {
        let mut people = People::open(options, address, listing.clone())?;
        spawn("foxglove", Box::new(move || people.turn()))?;
    }
    // Others look when they see the token, so it comes last.
    let token = session
        .liveliness()
        .declare_token(keys.alive(&session.zid().to_string()))
        .wait()
        .map_err(|error| anyhow::anyhow!("cannot say that this bridge is there: {error}"))?;
    let mut next_report = Instant::now();
    while !shutdown.wait(LOOK_EVERY) && threads.iter().all(|thread| !thread.is_finished()) {
        let Some(secs) = options.report_secs else {
            continue;
        };
        if Instant::now() >= next_report {
            next_report = Instant::now() + Duration::from_secs(secs);
            for line in counts.lines() {
                tracing::info!("{line}");
            }
        }
    }
    stop.store(true, Relaxed);
    drop(token);
    if let Some(service) = &service {
        service.release_participants();
    }
    let mut ended = Ok(());
    for thread in threads {
        let thread = thread.join();
        ended = ended.and(thread.unwrap_or_else(|_| Err(anyhow::anyhow!("a thread panicked"))));
    }
    ended
}
