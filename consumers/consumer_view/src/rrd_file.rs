//! A file of rerun that is written message by message.
//!
//! Rerun's own file sink keeps what it knows of every chunk for an index at the file's end, and so
//! grows for as long as it is open. This one writes no index and keeps nothing; `rerun rrd optimize`
//! adds an index to a finished file. A write that fails is remembered for [`Health::check`], and the
//! file ends with the last whole message, so that a full disk costs only what no longer fitted.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use parking_lot::Mutex;
use rerun::external::re_log_encoding::{Encoder, EncodingOptions};
use rerun::external::re_log_types::LogMsg;
use rerun::sink::{LogSink, SinkFlushError};
use rerun::{RecordingStream, RecordingStreamBuilder};

use crate::rerun;

/// Whether everything so far could be written. Clones share it; that of a viewer which listens is
/// always well.
#[derive(Clone, Debug, Default)]
pub struct Health {
    failure: Arc<Mutex<Option<String>>>,
}

impl Health {
    /// Passes while nothing has failed.
    ///
    /// # Errors
    /// The sentence of the first write that failed.
    pub fn check(&self) -> anyhow::Result<()> {
        let failure = self.failure.lock();
        match &*failure {
            None => Ok(()),
            Some(sentence) => Err(anyhow::Error::msg(sentence.clone())),
        }
    }

    fn fail(&self, sentence: String) {
        let mut failure = self.failure.lock();
        failure.get_or_insert(sentence);
    }
}

/// Begins a recording into the new file `path`.
///
/// # Errors
/// If the file exists or cannot be made.
pub fn record_into(
    builder: RecordingStreamBuilder,
    path: &Path,
) -> anyhow::Result<(RecordingStream, Health)> {
    let whole = || -> anyhow::Result<_> {
        let file = WholeMessages {
            file: File::create_new(path)?,
            n_bytes: 0,
        };
        let options = EncodingOptions::PROTOBUF_COMPRESSED;
        let mut encoder = Encoder::new_eager(rerun::build_info().version, options, file)?;
        encoder.do_not_emit_footer();
        Ok(encoder)
    };
    let encoder = whole().with_context(|| format!("cannot write {}", path.display()))?;
    let health = Health::default();
    let sink = RrdFile {
        name: path.display().to_string(),
        encoder: Mutex::new(encoder),
        health: health.clone(),
    };
    let (_, store, properties, batcher, hooks, _) = builder.into_args();
    let stream = RecordingStream::new(store, properties, batcher, hooks, Box::new(sink))?;
    Ok((stream, health))
}

struct RrdFile {
    name: String,
    encoder: Mutex<Encoder<WholeMessages>>,
    health: Health,
}

impl LogSink for RrdFile {
    fn send(&self, message: LogMsg) {
        if self.health.check().is_err() {
            return;
        }
        let mut encoder = self.encoder.lock();
        if let Err(error) = encoder.append(&message) {
            let cause = std::error::Error::source(&error).map(ToString::to_string);
            self.health.fail(format!(
                "cannot write {}: {}; what was written before can be opened",
                self.name,
                cause.unwrap_or_else(|| error.to_string())
            ));
        }
    }

    fn flush_blocking(&self, _timeout: Duration) -> Result<(), SinkFlushError> {
        let checked = self.health.check();
        checked.map_err(|error| SinkFlushError::Failed {
            message: error.to_string(),
        })
    }
}

/// A file that holds whole writes only: one that fails half-way is cut off again.
struct WholeMessages {
    file: File,
    n_bytes: u64,
}

impl Write for WholeMessages {
    fn write(&mut self, message: &[u8]) -> io::Result<usize> {
        if let Err(error) = self.file.write_all(message) {
            // Without the cut the file still opens up to here, with a warning.
            let _ = self.file.set_len(self.n_bytes);
            return Err(error);
        }
        self.n_bytes += message.len() as u64;
        Ok(message.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}
