//! What a binary says of its own making: `--version` in one word, `--version --verbose` in full.
//!
//! `./gantry package` gives the commit and the compiler through the environment of the build. A
//! build in a working tree has neither: its sources may differ from every commit.

/// Commit that a package was built from; `None` in a working tree's build.
pub const COMMIT: Option<&str> = option_env!("GANTRY_COMMIT");
/// Compiler that built a package, e.g. `rustc 1.95.0`; `None` in a working tree's build.
const COMPILER: Option<&str> = option_env!("GANTRY_COMPILER");

/// Cargo's profile: this workspace has no other two, and only one of them has debug assertions.
const PROFILE: &str = if cfg!(debug_assertions) {
    "dev"
} else {
    "release"
};

/// The version, then one line each for the commit, what was built, what for and how.
pub fn verbose_version() -> String {
    format!(
        "{}\ncommit: {}\ncompiler: {}\nfeatures: all (none is optional)\ntarget: {}-{}-{}\nprofile: {}",
        env!("CARGO_PKG_VERSION"),
        COMMIT.unwrap_or("a working tree's build"),
        COMPILER.unwrap_or("that of the working tree"),
        std::env::consts::ARCH,
        std::env::consts::OS,
        if cfg!(target_env = "gnu") {
            "gnu"
        } else {
            "other"
        },
        PROFILE,
    )
}

/// Whether these arguments, without the program's name, ask for the version in full.
pub(crate) fn asked_verbosely(words: impl IntoIterator<Item = std::ffi::OsString>) -> bool {
    let (mut version, mut verbose) = (false, false);
    for word in words.into_iter().take_while(|word| word != "--") {
        version |= word == "--version" || word == "-V";
        verbose |= word == "--verbose" || word == "-v";
    }
    version && verbose
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(words: &[&str]) -> bool {
        asked_verbosely(words.iter().map(Into::into))
    }

    #[test]
    fn the_order_does_not_matter_and_what_follows_two_dashes_is_not_ours() {
        assert!(asked(&["--version", "--verbose"]));
        assert!(asked(&["-v", "--domain", "a", "-V"]));
        assert!(!asked(&["--version"]));
        assert!(!asked(&["--verbose", "up"]));
        assert!(!asked(&["--version", "--", "--verbose"]));
    }

    #[test]
    fn the_first_line_is_the_version_alone() {
        let text = verbose_version();
        assert_eq!(text.lines().next(), Some(env!("CARGO_PKG_VERSION")));
        assert_eq!(text.lines().count(), 6, "{text}");
        let profile = if cfg!(debug_assertions) {
            "profile: dev"
        } else {
            "profile: release"
        };
        assert_eq!(text.lines().last(), Some(profile));
    }
}
