//! A private place on the bus for one test, on real shared memory.

use std::sync::atomic::{AtomicU32, Ordering};

use schema_bus::{Bus, BusOptions};

/// Its root folder and the prefix of its files, which is never used again.
pub struct Place(tempfile::TempDir, String);

impl Place {
    /// `name` is that of the test.
    pub fn new(name: &str) -> Place {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let prefix = format!("gk{}_{name}{number}_", std::process::id());
        Place(tempfile::tempdir().unwrap(), prefix)
    }

    pub fn bus(&self, program: &str) -> Bus {
        let options = BusOptions {
            iceoryx_root: Some(self.0.path().join("iox")),
            prefix: Some(self.1.clone()),
        };
        Bus::open_with("d", program, &options).unwrap()
    }
}

impl Drop for Place {
    /// Removes the one file that iceoryx2 keeps for ever.
    fn drop(&mut self) {
        for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&self.1) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}
