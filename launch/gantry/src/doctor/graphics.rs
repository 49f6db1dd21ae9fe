//! Vulkan: loader, drivers, adapters.

use std::path::PathBuf;
use std::time::Duration;

use super::finding::Finding;
use crate::programs;

const INSTALL: &str = "apt-get install libvulkan1 mesa-vulkan-drivers (as root)";
/// Loading a driver for the first time takes seconds on a slow disk.
const PATIENCE: Duration = Duration::from_secs(60);

pub fn look() -> Vec<Finding> {
    vec![loader(), drivers(), adapters()]
}

fn loader() -> Finding {
    let found = library_folders()
        .into_iter()
        .map(|folder| folder.join("libvulkan.so.1"))
        .find(|path| path.exists());
    match found {
        Some(path) => Finding::ok("vulkan loader", path.display().to_string()),
        None => Finding::fail(
            "vulkan loader",
            "libvulkan.so.1 is in none of the usual folders",
            INSTALL,
        ),
    }
}

fn library_folders() -> Vec<PathBuf> {
    let own = std::env::var_os("LD_LIBRARY_PATH").unwrap_or_default();
    let machine = std::env::consts::ARCH;
    let usual = [
        format!("/usr/lib/{machine}-linux-gnu"),
        "/usr/lib64".into(),
        "/usr/lib".into(),
        "/usr/local/lib".into(),
        "/run/opengl-driver/lib".into(),
    ];
    std::env::split_paths(&own)
        .chain(usual.map(PathBuf::from))
        .collect()
}

fn drivers() -> Finding {
    for name in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
        let Some(files) = std::env::var_os(name).filter(|files| !files.is_empty()) else {
            continue;
        };
        let missing: Vec<_> = std::env::split_paths(&files)
            .filter(|path| !path.exists())
            .map(|path| path.display().to_string())
            .collect();
        let text = format!("{name}={}", files.to_string_lossy());
        return if missing.is_empty() {
            Finding::ok("vulkan drivers", text)
        } else {
            Finding::fail(
                "vulkan drivers",
                format!("{text}, but there is no {}", missing.join(", ")),
                format!("unset {name}, or correct it"),
            )
        };
    }
    let folders = [
        "/usr/share/vulkan/icd.d",
        "/etc/vulkan/icd.d",
        "/usr/local/share/vulkan/icd.d",
        "/run/opengl-driver/share/vulkan/icd.d",
    ];
    let mut names: Vec<String> = folders
        .iter()
        .filter_map(|folder| std::fs::read_dir(folder).ok())
        .flatten()
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter_map(|name| Some(name.strip_suffix(".json")?.to_owned()))
        .collect();
    names.sort();
    if names.is_empty() {
        Finding::fail("vulkan drivers", "none is installed", INSTALL)
    } else {
        Finding::ok("vulkan drivers", names.join(", "))
    }
}

fn adapters() -> Finding {
    const WHAT: &str = "graphics";
    let simd = match programs::find("simd") {
        Ok(simd) => simd,
        Err(error) => {
            return Finding::warn(
                WHAT,
                format!("not asked: {error}"),
                "cargo build --release --workspace",
            );
        }
    };
    let text = match programs::output_of(&simd, &["--adapters", "--json"], PATIENCE) {
        Ok(text) => text,
        Err(error) => return Finding::fail(WHAT, format!("{error:#}"), INSTALL),
    };
    judge(&text)
}

/// The finding from the output of `simd --adapters --json`.
fn judge(text: &str) -> Finding {
    const WHAT: &str = "graphics";
    let adapters: Vec<serde_json::Value> = text
        .lines()
        .filter_map(|line| serde_json::from_str(line).ok())
        .collect();
    let describe = |adapter: &serde_json::Value| {
        let name = adapter["name"].as_str().unwrap_or("?");
        let import = if adapter["import"] == true {
            "no copies"
        } else {
            "one copy per frame"
        };
        format!("{name} ({import})")
    };
    let all = adapters.iter().map(describe).collect::<Vec<_>>().join("; ");
    if adapters.is_empty() {
        return Finding::fail(WHAT, "no adapter can render", INSTALL);
    }
    if adapters.iter().any(|adapter| adapter["import"] == true) {
        return Finding::ok(WHAT, all);
    }
    let fix =
        "a driver with VK_EXT_external_memory_host saves that copy: Mesa, or NVIDIA 470 and later";
    Finding::warn(WHAT, all, fix)
}

#[cfg(test)]
mod tests {
    use super::super::Grade;
    use super::*;

    #[test]
    fn an_adapter_without_import_is_slower_and_none_is_a_failure() {
        let fast = r#"{"name":"llvmpipe","software":true,"driver":"x","import":true}"#;
        let slow = r#"{"name":"old","software":false,"driver":"x","import":false}"#;
        assert_eq!(judge(&format!("{slow}\n{fast}\n")).grade, Grade::Ok);
        assert_eq!(judge(slow).grade, Grade::Warn);
        assert_eq!(judge("").grade, Grade::Fail);
    }
}
