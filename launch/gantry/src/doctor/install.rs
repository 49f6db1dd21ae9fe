//! The exact command that installs a missing piece on this machine.

/// A piece of the system that Gantry needs and does not bring.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Piece {
    /// The library that finds graphics drivers.
    VulkanLoader,
    /// Mesa's drivers, among them one for machines without a GPU.
    VulkanDrivers,
}

/// Package managers, the program that gives each away, and what they call the pieces.
const MANAGERS: [(&str, &str, &str, &str); 4] = [
    (
        "apt-get",
        "apt-get install -y",
        "libvulkan1",
        "mesa-vulkan-drivers",
    ),
    (
        "dnf",
        "dnf install -y",
        "vulkan-loader",
        "mesa-vulkan-drivers",
    ),
    (
        "pacman",
        "pacman -S --noconfirm",
        "vulkan-icd-loader",
        "vulkan-swrast",
    ),
    ("zypper", "zypper install -y", "libvulkan1", "libvulkan_lvp"),
];

/// What to type, on this machine, to install these pieces.
pub fn command(pieces: &[Piece]) -> String {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let is_there = |name: &str| {
        std::env::split_paths(&path).any(|folder| crate::programs::is_program(&folder.join(name)))
    };
    command_with(pieces, is_there, nix::unistd::geteuid().is_root())
}

fn command_with(pieces: &[Piece], is_there: impl Fn(&str) -> bool, is_root: bool) -> String {
    let manager = MANAGERS.iter().find(|manager| is_there(manager.0));
    let (_, install, loader, drivers) = manager.unwrap_or(&MANAGERS[0]);
    let names = pieces.iter().map(|piece| match piece {
        Piece::VulkanLoader => *loader,
        Piece::VulkanDrivers => *drivers,
    });
    let words: Vec<&str> = std::iter::once(*install).chain(names).collect();
    match manager {
        Some(_) => root_may(&words.join(" "), is_root),
        None => format!("install what Debian calls {}", words[1..].join(" and ")),
    }
}

/// A command that only root may give, as this user types it.
pub fn as_root(command: &str) -> String {
    root_may(command, nix::unistd::geteuid().is_root())
}

fn root_may(command: &str, is_root: bool) -> String {
    if is_root {
        command.to_owned()
    } else {
        format!("sudo {command}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_is_that_of_the_machine_and_of_the_user() {
        let both = [Piece::VulkanLoader, Piece::VulkanDrivers];
        assert_eq!(
            command_with(&both, |name| name == "apt-get", false),
            "sudo apt-get install -y libvulkan1 mesa-vulkan-drivers"
        );
        assert_eq!(
            command_with(&both[..1], |name| name == "pacman", true),
            "pacman -S --noconfirm vulkan-icd-loader"
        );
        assert_eq!(
            command_with(&both, |_| false, false),
            "install what Debian calls libvulkan1 and mesa-vulkan-drivers"
        );
    }
}
