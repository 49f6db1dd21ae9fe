//! Where a new project gets Gantry's libraries from: a checkout on this machine, a git repository, or
//! the package that this program was installed with.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, ensure};
use launch_cli::wrong_usage;

use crate::cli::{ConsumerArgs, Lang};
use crate::programs;

/// Where the libraries come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Origin {
    /// A folder with Gantry's source, absolute and without links.
    Checkout(PathBuf),
    /// A repository, and the commit, tag or branch; without one the newest commit.
    Git { url: String, rev: Option<String> },
    /// A folder with `include` and `lib`, into which this program was installed.
    Installed(PathBuf),
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Origin::Checkout(folder) | Origin::Installed(folder) => {
                write!(f, "{}", folder.display())
            }
            Origin::Git { url, rev: None } => write!(f, "{url}"),
            Origin::Git {
                url,
                rev: Some(rev),
            } => write!(f, "{url} at {rev}"),
        }
    }
}

/// The checkout that this program was built in. A package's programs know of none: the folder they
/// were built in is nobody's, and would make their bytes differ from those built in another one.
fn own_checkout() -> anyhow::Result<PathBuf> {
    ensure!(
        launch_cli::build_info::COMMIT.is_none(),
        "this program is from a package"
    );
    checkout(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")))
}

impl Origin {
    /// What the options ask for; without any the checkout that this program was built from.
    ///
    /// # Errors
    /// A sentence if there is no checkout where one must be.
    pub fn of(wanted: &ConsumerArgs) -> anyhow::Result<Origin> {
        if let Some(folder) = &wanted.checkout {
            return Ok(Origin::Checkout(checkout(folder).with_context(|| {
                format!(
                    "--checkout is {}, but that is no checkout of Gantry",
                    folder.display()
                )
            })?));
        }
        let built_from = own_checkout();
        if let Some(url) = &wanted.git {
            ensure!(
                wanted.lang != Lang::Cpp,
                wrong_usage(
                    "--git goes with --lang rust and python: a project in C++ is linked with the library of a package, or of a checkout after ./gantry build"
                )
            );
            ensure!(
                !url.is_empty() && !url.contains(['"', '\\', '\n', ' ']),
                wrong_usage(format!("--git is {url:?}, which is no address"))
            );
            let rev = wanted.rev.clone().or_else(|| head_of(&built_from.ok()?));
            return Ok(Origin::Git {
                url: url.clone(),
                rev,
            });
        }
        if let Ok(checkout) = built_from {
            return Ok(Origin::Checkout(checkout));
        }
        let installed = installed_prefix(&programs::own_folder()?);
        match (wanted.lang, installed) {
            (Lang::Python | Lang::Cpp, Some(prefix)) => Ok(Origin::Installed(prefix)),
            (Lang::Cpp, None) => Err(wrong_usage(
                "this gantry was not built from a checkout that is still there, and no folder above it has include/gantry/gantry.hpp; name a checkout with --checkout DIR, or install a package",
            )),
            (Lang::Rust | Lang::Python, _) => Err(wrong_usage(
                "this gantry was not built from a checkout that is still there, so say where the project gets Gantry's libraries from: --checkout DIR or --git URL",
            )),
        }
    }

    /// The folder with Gantry's source on this machine, if the project uses it.
    pub fn checkout(&self) -> Option<&Path> {
        match self {
            Origin::Checkout(folder) => Some(folder),
            Origin::Git { .. } | Origin::Installed(_) => None,
        }
    }

    /// The folder with `include` and `lib` of C and C++, if it is on this machine.
    pub fn prefix(&self) -> Option<PathBuf> {
        match self {
            Origin::Checkout(root) => Some(root.join("consumers/consumer_c")),
            Origin::Installed(prefix) => Some(prefix.clone()),
            Origin::Git { .. } => None,
        }
    }

    /// What installing a Python project does about `gantry`, for its page.
    pub fn install_note(&self) -> &'static str {
        match self {
            Origin::Installed(_) => "where the wheel gantry_sim is installed, too",
            Origin::Checkout(_) | Origin::Git { .. } => {
                "builds gantry's native module, which needs Rust"
            }
        }
    }

    /// The value of a dependency on one of Gantry's crates, which lies in `folder` of the source.
    pub fn crate_dependency(&self, folder: &str) -> String {
        match self {
            Origin::Checkout(root) => {
                let path = toml::Value::from(root.join(folder).to_string_lossy().as_ref());
                format!("{{ path = {path} }}")
            }
            Origin::Git { url, rev: None } => {
                format!("{{ git = {} }}", toml::Value::from(url.as_str()))
            }
            Origin::Git {
                url,
                rev: Some(rev),
            } => format!(
                "{{ git = {}, rev = {} }}",
                toml::Value::from(url.as_str()),
                toml::Value::from(rev.as_str())
            ),
            // A package holds no crates; `of` refuses it for Rust.
            Origin::Installed(_) => toml::Value::from(env!("CARGO_PKG_VERSION")).to_string(),
        }
    }

    /// The requirement of the Python package, as pip reads it.
    pub fn python_requirement(&self) -> String {
        const FOLDER: &str = "consumers/consumer_python";
        match self {
            Origin::Checkout(root) => {
                let path = root.join(FOLDER);
                format!("gantry-sim @ file://{}", in_url(&path.to_string_lossy()))
            }
            Origin::Git { url, rev } => {
                let rev = rev.as_ref().map_or(String::new(), |rev| format!("@{rev}"));
                format!("gantry-sim @ git+{url}{rev}#subdirectory={FOLDER}")
            }
            Origin::Installed(_) => format!("gantry-sim=={}", env!("CARGO_PKG_VERSION")),
        }
    }
}

/// The folder without links, if it holds Gantry's source.
fn checkout(folder: &Path) -> anyhow::Result<PathBuf> {
    let folder = folder.canonicalize()?;
    let wanted = folder.join("consumers/consumer_kit/Cargo.toml");
    ensure!(wanted.is_file(), "there is no {}", wanted.display());
    Ok(folder)
}

/// The nearest folder above a program in which a package has laid the headers of C++.
fn installed_prefix(programs: &Path) -> Option<PathBuf> {
    let has_headers = |folder: &&Path| folder.join("include/gantry/gantry.hpp").is_file();
    programs.ancestors().find(has_headers).map(Path::to_owned)
}

/// The commit that a checkout is at; `None` without git.
fn head_of(folder: &Path) -> Option<String> {
    let git = programs::find("git").ok()?;
    let words = ["-C", folder.to_str()?, "rev-parse", "HEAD"];
    let head = programs::output_of(&git, &words, Duration::from_secs(10)).ok()?;
    let head = head.trim();
    (!head.is_empty()).then(|| head.to_owned())
}

/// A path in a URL: everything but letters, digits and `/-_.~` as percent and two hexadecimal
/// digits.
fn in_url(path: &str) -> String {
    let mut url = String::new();
    for byte in path.bytes() {
        if byte.is_ascii_alphanumeric() || b"/-_.~".contains(&byte) {
            url.push(char::from(byte));
        } else {
            url += &format!("%{byte:02X}");
        }
    }
    url
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dependencies_are_written_as_cargo_and_pip_read_them() {
        let folder = Origin::Checkout("/opt/my \"gantry\"".into());
        let dependency = folder.crate_dependency("consumers/consumer_kit");
        let table: toml::Table = format!("x = {dependency}").parse().unwrap();
        assert_eq!(
            table["x"]["path"].as_str(),
            Some("/opt/my \"gantry\"/consumers/consumer_kit")
        );
        assert_eq!(
            folder.python_requirement(),
            "gantry-sim @ file:///opt/my%20%22gantry%22/consumers/consumer_python"
        );
        let git = |rev: Option<&str>| Origin::Git {
            url: "https://example.org/gantry.git".into(),
            rev: rev.map(str::to_owned),
        };
        assert_eq!(
            git(None).crate_dependency("tests/test_kit"),
            "{ git = \"https://example.org/gantry.git\" }"
        );
        assert_eq!(
            git(Some("abc")).crate_dependency("tests/test_kit"),
            "{ git = \"https://example.org/gantry.git\", rev = \"abc\" }"
        );
        assert_eq!(
            git(Some("abc")).python_requirement(),
            "gantry-sim @ git+https://example.org/gantry.git@abc#subdirectory=consumers/consumer_python"
        );
    }

    #[test]
    fn an_installation_is_known_by_its_headers() {
        let prefix = tempfile::tempdir().unwrap();
        let bin = prefix.path().join("bin");
        std::fs::create_dir(&bin).unwrap();
        assert_eq!(installed_prefix(&bin), None);
        std::fs::create_dir_all(prefix.path().join("include/gantry")).unwrap();
        std::fs::write(prefix.path().join("include/gantry/gantry.hpp"), "").unwrap();
        let found = installed_prefix(&bin).unwrap();
        assert_eq!(found, prefix.path());
        assert_eq!(
            Origin::Installed(found).python_requirement(),
            format!("gantry-sim=={}", env!("CARGO_PKG_VERSION"))
        );
    }

    #[test]
    fn a_checkout_is_known_by_its_source() {
        assert!(checkout(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))).is_ok());
        assert!(checkout(&std::env::temp_dir()).is_err());
    }
}
