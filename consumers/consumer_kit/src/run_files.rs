//! Names of the files of a consumer that outlives the simulator: every run gets a file of its own.

use std::path::{Path, PathBuf};

/// `drive.mcap` for run 1 of the simulator, `drive.2.mcap` for run 2.
pub fn file_of_run(path: &Path, run: u32) -> PathBuf {
    if run == 1 {
        return path.to_path_buf();
    }
    let extension = path.extension().map_or(String::new(), |extension| {
        format!(".{}", extension.to_string_lossy())
    });
    path.with_extension(format!("{run}{extension}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_run_of_the_simulator_gets_a_file_of_its_own() {
        let name = |path: &str, run| file_of_run(Path::new(path), run);
        assert_eq!(name("a/drive.mcap", 1), Path::new("a/drive.mcap"));
        assert_eq!(name("a/drive.mcap", 2), Path::new("a/drive.2.mcap"));
        assert_eq!(name("drive", 3), Path::new("drive.3"));
    }
}
