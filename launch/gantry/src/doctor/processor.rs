//! Processors: how many, how fast they are allowed to be, and the clock that dates frames.

use super::finding::Finding;
use super::install::as_root;

/// Folder of the first processor's frequency.
const FREQUENCY: &str = "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor";
const CLOCK: &str = "/sys/devices/system/clocksource/clocksource0/current_clocksource";
/// Governors that keep a processor slow while it waits for readers: a tick's work comes in bursts.
const SLOW_GOVERNORS: [&str; 2] = ["powersave", "conservative"];
/// Driver whose "powersave" is not slow: it follows the load by itself.
const SELF_GOVERNED: [&str; 2] = ["intel_pstate", "amd-pstate-epp"];
/// Clocks that are read without a system call.
const FAST_CLOCKS: [&str; 4] = [
    "tsc",
    "kvm-clock",
    "hyperv_clocksource_tsc_page",
    "arch_sys_counter",
];

pub fn look() -> Vec<Finding> {
    let read = |path: &str| {
        std::fs::read_to_string(path)
            .map(|text| text.trim().to_owned())
            .unwrap_or_default()
    };
    let driver = read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_driver");
    let mut findings = vec![kernel(
        &read("/proc/sys/kernel/osrelease"),
        &read("/proc/version"),
    )];
    findings.push(count(
        std::thread::available_parallelism().map(|n| n.get()).ok(),
    ));
    findings.push(governor(&read(FREQUENCY), &driver));
    findings.extend(clock(&read(CLOCK)));
    findings
}

/// The kernel's release. Windows' own Linux has shared memory and Vulkan of another kind.
fn kernel(release: &str, version: &str) -> Finding {
    const WHAT: &str = "kernel";
    let text = format!("Linux {release}, {}", std::env::consts::ARCH);
    if version.to_lowercase().contains("microsoft") {
        return Finding::warn(
            WHAT,
            format!("{text}, within Windows: never tried"),
            "a Linux of its own, or a virtual machine",
        );
    }
    Finding::ok(WHAT, text)
}

fn count(n: Option<usize>) -> Finding {
    const WHAT: &str = "processors";
    match n {
        Some(n) if n >= 2 => Finding::ok(WHAT, n.to_string()),
        Some(n) => Finding::warn(
            WHAT,
            format!("{n}: readers and the simulator wait for each other"),
            "give the machine two (in a container: --cpus=2 or more)",
        ),
        None => Finding::warn(WHAT, "cannot be counted", ""),
    }
}

fn governor(name: &str, driver: &str) -> Finding {
    const WHAT: &str = "governor";
    if name.is_empty() {
        return Finding::ok(WHAT, "none; the machine's host decides");
    }
    if SLOW_GOVERNORS.contains(&name) && !SELF_GOVERNED.contains(&driver) {
        return Finding::warn(
            WHAT,
            format!("{name}: processors stay slow between ticks, and figures mean little"),
            as_root(
                "sh -c 'echo performance | tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor'",
            ),
        );
    }
    Finding::ok(WHAT, name)
}

/// A slow clock costs a system call for every time stamp.
fn clock(name: &str) -> Option<Finding> {
    const WHAT: &str = "clock";
    if name.is_empty() {
        return None;
    }
    Some(if FAST_CLOCKS.contains(&name) {
        Finding::ok(WHAT, name)
    } else {
        Finding::warn(
            WHAT,
            format!("{name}: every look at the time is a system call"),
            as_root(&format!(
                "sh -c 'echo tsc > {CLOCK}', if the machine offers it"
            )),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::super::Grade;
    use super::*;

    #[test]
    fn slow_processors_and_clocks_are_warnings() {
        assert_eq!(count(Some(1)).grade, Grade::Warn);
        assert_eq!(count(Some(2)).grade, Grade::Ok);
        let finding = governor("powersave", "acpi-cpufreq");
        assert_eq!(finding.grade, Grade::Warn);
        assert!(finding.fix.contains("echo performance"), "{finding:?}");
        assert_eq!(governor("powersave", "intel_pstate").grade, Grade::Ok);
        assert_eq!(governor("performance", "").grade, Grade::Ok);
        assert_eq!(governor("", "").grade, Grade::Ok);
        assert_eq!(clock("hpet").unwrap().grade, Grade::Warn);
        assert_eq!(clock("tsc").unwrap().grade, Grade::Ok);
        assert!(clock("").is_none());
        let windows = "Linux version 5.15.90.1-microsoft-standard-WSL2";
        assert_eq!(kernel("5.15.90.1", windows).grade, Grade::Warn);
        assert_eq!(kernel("6.1.0", "Linux version 6.1.0").grade, Grade::Ok);
    }
}
