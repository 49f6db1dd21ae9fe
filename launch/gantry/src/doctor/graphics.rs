//! Vulkan: loader, drivers, adapters, and whether this user may open the GPU.

use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::finding::Finding;
use super::install::{self, Piece};
use super::python;
use crate::programs;

/// What cannot render at all lacks one of the two.
const BOTH: [Piece; 2] = [Piece::VulkanLoader, Piece::VulkanDrivers];
/// Where the kernel keeps the GPUs of Mesa's drivers.
const GPUS: &str = "/dev/dri";
/// A device that only NVIDIA's kernel driver makes.
const NVIDIA: &str = "/dev/nvidiactl";
/// Loading a driver for the first time takes seconds on a slow disk.
const PATIENCE: Duration = Duration::from_secs(60);

pub fn look() -> Vec<Finding> {
    let mut findings = vec![loader(), drivers(Path::new(NVIDIA).exists())];
    findings.extend(gpus(&render_nodes()));
    findings.push(adapters());
    findings
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
            install::command(&BOTH[..1]),
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

fn drivers(has_nvidia: bool) -> Finding {
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
    judge_drivers(&names, has_nvidia)
}

/// The finding from the names of the drivers' files.
fn judge_drivers(names: &[String], has_nvidia: bool) -> Finding {
    const WHAT: &str = "vulkan drivers";
    if names.is_empty() {
        return Finding::fail(WHAT, "none is installed", install::command(&BOTH[1..]));
    }
    let all = names.join(", ");
    if has_nvidia && !names.iter().any(|name| name.contains("nvidia")) {
        return Finding::warn(
            WHAT,
            format!("{all}; there is an NVIDIA GPU, but no nvidia_icd.json"),
            "install the driver's Vulkan part (libnvidia-gl-VERSION or nvidia-vulkan-icd); in a container: \
             --gpus all -e NVIDIA_DRIVER_CAPABILITIES=all",
        );
    }
    Finding::ok(WHAT, all)
}

/// A GPU's device: its path, its group, and whether this user may open it.
struct RenderNode {
    path: PathBuf,
    group: u32,
    may_open: bool,
}

fn render_nodes() -> Vec<RenderNode> {
    let entries = std::fs::read_dir(GPUS).into_iter().flatten().flatten();
    let mut nodes: Vec<_> = entries
        .filter(|entry| entry.file_name().to_string_lossy().starts_with("renderD"))
        .filter_map(|entry| {
            let path = entry.path();
            let options = std::fs::OpenOptions::new()
                .read(true)
                .write(true)
                .open(&path);
            Some(RenderNode {
                group: path.metadata().ok()?.gid(),
                may_open: options.is_ok(),
                path,
            })
        })
        .collect();
    nodes.sort_by(|a, b| a.path.cmp(&b.path));
    nodes
}

/// A GPU that the user may not open is left out by its driver without a word.
fn gpus(nodes: &[RenderNode]) -> Option<Finding> {
    const WHAT: &str = "gpu devices";
    let closed = nodes.iter().find(|node| !node.may_open);
    let Some(node) = closed else {
        let paths: Vec<_> = nodes
            .iter()
            .map(|node| node.path.display().to_string())
            .collect();
        return (!nodes.is_empty()).then(|| Finding::ok(WHAT, paths.join(", ")));
    };
    let group = nix::unistd::Group::from_gid(node.group.into())
        .ok()
        .flatten()
        .map_or(node.group.to_string(), |group| group.name);
    Some(Finding::warn(
        WHAT,
        format!(
            "{} may not be opened by this user, so its GPU is not used",
            node.path.display()
        ),
        format!(
            "{}, then log in again; in a container: --device {GPUS}",
            install::as_root(&format!("usermod -aG {group} $USER"))
        ),
    ))
}

fn adapters() -> Finding {
    const WHAT: &str = "graphics";
    let simd = match programs::find("simd") {
        Ok(simd) => simd,
        Err(error) => {
            return Finding::fail(WHAT, format!("not asked: {error}"), python::reinstall());
        }
    };
    let text = match programs::output_of(&simd, &["--adapters", "--json"], PATIENCE) {
        Ok(text) => text,
        Err(error) => return Finding::fail(WHAT, format!("{error:#}"), install::command(&BOTH)),
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
        return Finding::fail(WHAT, "no adapter can render", install::command(&BOTH));
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

    #[test]
    fn a_gpu_without_its_driver_or_without_rights_is_named() {
        let names = ["lvp_icd.x86_64".to_owned()];
        assert_eq!(judge_drivers(&names, false).grade, Grade::Ok);
        let finding = judge_drivers(&names, true);
        assert_eq!(finding.grade, Grade::Warn);
        assert!(finding.fix.contains("NVIDIA_DRIVER_CAPABILITIES"));
        let both = ["nvidia_icd".to_owned(), names[0].clone()];
        assert_eq!(judge_drivers(&both, true).grade, Grade::Ok);
        assert_eq!(judge_drivers(&[], true).grade, Grade::Fail);

        let node = |may_open| RenderNode {
            path: "/dev/dri/renderD128".into(),
            group: 0,
            may_open,
        };
        assert!(gpus(&[]).is_none(), "software renders without a device");
        assert_eq!(gpus(&[node(true)]).unwrap().grade, Grade::Ok);
        let finding = gpus(&[node(true), node(false)]).unwrap();
        assert_eq!(finding.grade, Grade::Warn);
        assert!(
            finding.fix.contains("usermod -aG root $USER"),
            "{finding:?}"
        );
    }
}
