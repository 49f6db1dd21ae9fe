//! The files of writers' segments in `/dev/shm`, found by the numbers of their ports.

use std::collections::HashMap;
use std::fs::File;
use std::path::{Path, PathBuf};

use iceoryx2::config::Config;

use crate::memory::root::SHM;

/// The file of a writer whose segment does not grow; `None` if it grows, or is another user's.
pub(crate) fn fixed_segment_file(config: &Config, port: u128) -> Option<File> {
    let global = &config.global;
    let (prefix, suffix) = (
        global.prefix.to_string(),
        global.service.data_segment_suffix.to_string(),
    );
    let folder = Path::new(SHM);
    let entries = std::fs::read_dir(folder).ok()?.flatten();
    let is_its = |name: &str| {
        let stem = name.strip_prefix(&prefix)?.strip_suffix(&suffix)?;
        (!stem.contains("__")).then(|| port_of_file(stem))?
    };
    let mut names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
    let name = names.find(|name| is_its(name) == Some(port))?;
    File::options()
        .read(true)
        .write(true)
        .open(folder.join(name))
        .ok()
}

/// Files of segments by the number of their port: `PREFIX…_NUMBER.data`, or `…_NUMBER__PART.data`
/// for one that has grown.
pub(crate) fn segment_files(
    folder: &Path,
    prefix: &str,
    suffix: &str,
) -> HashMap<u128, Vec<PathBuf>> {
    let mut files: HashMap<u128, Vec<PathBuf>> = HashMap::new();
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    for entry in entries {
        let name = entry.file_name().to_string_lossy().into_owned();
        let stem = name
            .strip_prefix(prefix)
            .and_then(|n| n.strip_suffix(suffix));
        if let Some(id) = stem.and_then(port_of_file) {
            files.entry(id).or_default().push(entry.path());
        }
    }
    files
}

fn port_of_file(stem: &str) -> Option<u128> {
    let whole = stem.split_once("__").map_or(stem, |(whole, _)| whole);
    whole.rsplit('_').next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_a_segment_tells_its_port() {
        assert_eq!(
            port_of_file("0354a2_1109194381732146492770300737224"),
            Some(1_109_194_381_732_146_492_770_300_737_224)
        );
        assert_eq!(port_of_file("0354a2_26937__0"), Some(26_937));
        assert_eq!(port_of_file("0354a2_26937__mgmt"), Some(26_937));
        assert_eq!(port_of_file("node.0_10_0"), Some(0));
        assert_eq!(port_of_file("nonsense"), None);
    }
}
