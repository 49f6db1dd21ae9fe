//! A private place on the bus for one test, on real shared memory.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};

use iceoryx2::config::Config;
use iceoryx2::prelude::{FileName, Path, SemanticString as _};
use schema_bus::{Bus, BusOptions};

/// Its root folder and the prefix of its files. Dropped, it removes them, after it has asserted that
/// none is left.
pub struct Place {
    pub folder: tempfile::TempDir,
    pub prefix: String,
    is_left_clean: bool,
}

impl Place {
    pub fn new(name: &str) -> Place {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        Place {
            folder: tempfile::tempdir().unwrap(),
            prefix: format!("gb{}_{name}{number}_", std::process::id()),
            is_left_clean: true,
        }
    }

    /// A place in which programs that do not know us may leave files behind.
    pub fn with_foreigners(name: &str) -> Place {
        let mut place = Place::new(name);
        place.is_left_clean = false;
        place
    }

    /// Files in its folder and in shared memory.
    pub fn files(&self) -> BTreeSet<PathBuf> {
        let in_memory = self.left_over().into_iter();
        let mut found: BTreeSet<PathBuf> = in_memory
            .map(|name| std::path::Path::new("/dev/shm").join(name))
            .collect();
        let mut folders = vec![self.folder.path().to_owned()];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                match path.is_dir() {
                    true => folders.push(path),
                    false => drop(found.insert(path)),
                }
            }
        }
        found
    }

    pub fn root(&self) -> PathBuf {
        self.folder.path().join("iceoryx2")
    }

    pub fn options(&self) -> BusOptions {
        BusOptions {
            iceoryx_root: Some(self.root()),
            prefix: Some(self.prefix.clone()),
        }
    }

    pub fn bus(&self, program: &str) -> Bus {
        Bus::open_with("d", program, &self.options()).unwrap()
    }

    /// iceoryx2's own configuration of this place, for a program that does not know us.
    pub fn config(&self) -> Config {
        let mut config = Config::default();
        let root = self.root();
        let root = Path::new(root.to_str().unwrap().as_bytes()).unwrap();
        config.global.set_root_path(&root);
        config.global.prefix = FileName::new(self.prefix.as_bytes()).unwrap();
        config
    }

    /// Files of this place in shared memory, but for the one that iceoryx2 keeps for ever by
    /// design.
    pub fn left_over(&self) -> Vec<String> {
        let names = std::fs::read_dir("/dev/shm")
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names
            .filter(|name| name.starts_with(&self.prefix) && !name.ends_with(".global_mgmt"))
            .collect()
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let left = self.left_over();
        for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
            let name = entry.file_name();
            if name.to_string_lossy().starts_with(&self.prefix) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
        if self.is_left_clean && !std::thread::panicking() {
            assert_eq!(left, Vec::<String>::new(), "left in /dev/shm");
        }
    }
}
