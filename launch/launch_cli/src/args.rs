//! Flags and subcommands that every binary has: the common options, `completions <shell>` and the
//! hidden `man`.

use std::ffi::OsString;
use std::io::Write as _;
use std::ops::Deref;

use clap::parser::ValueSource;
use clap::{ArgAction, ArgMatches, Args, CommandFactory, Parser};

use crate::build_info;
use crate::logging::{self, ColorWhen, LogFormat, LogOptions};
use crate::man;

/// Domain of a program that is told no other; `schema_bus::names` has the same.
pub const DEFAULT_DOMAIN: &str = "gantry";
/// Environment variable with the domain of a program that is not given `--domain`;
/// `schema_bus::names` has the same.
pub const DOMAIN_VARIABLE: &str = "GANTRY_DOMAIN";

/// Flags that every binary has: `#[command(flatten)] basic: BasicArgs`. One that meets others on the
/// bus in whatever it does has [`CommonArgs`] in their place.
#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = "Common options")]
pub struct BasicArgs {
    /// Log more: -v debug, -vv trace
    #[arg(short, long, global = true, action = ArgAction::Count)]
    pub verbose: u8,

    /// Log less: -q warnings and errors, -qq errors only
    #[arg(short, long, global = true, action = ArgAction::Count, conflicts_with = "verbose")]
    pub quiet: u8,

    /// Colour on the terminal; NO_COLOR=1 turns "auto" off
    #[arg(
        long,
        global = true,
        value_name = "WHEN",
        value_enum,
        default_value_t,
        hide_possible_values = false
    )]
    pub color: ColorWhen,

    /// Form of the log lines on stderr
    #[arg(long, global = true, value_name = "FORM", value_enum, default_value_t)]
    pub log_format: LogFormat,

    /// End when the process with this id ends, which started this one
    #[arg(long, global = true, value_name = "PID", hide = true)]
    pub parent: Option<i32>,

    /// Do nothing, but refuse wrong arguments as ever: for tests of what help texts and pages show
    #[arg(long, global = true, hide = true)]
    pub check_arguments: bool,
}

impl BasicArgs {
    /// Starts logging to stderr as these flags ask; call once, before anything logs. A process that
    /// another of Gantry's programs started ends with that one from here on.
    pub fn init_logging(&self) {
        self.end_with_parent();
        logging::init(&LogOptions {
            verbose: self.verbose,
            quiet: self.quiet,
            color: self.color,
            format: self.log_format,
        });
    }

    /// Has the kernel send a SIGTERM when the process that started this one ends, if it said who it
    /// is ([`BasicArgs::init_logging`] does this too); ends this one if that has happened already.
    pub fn end_with_parent(&self) {
        if let Some(parent) = self.parent {
            end_with(parent);
        }
    }
}

/// The domain of a subcommand that meets others on the bus, in a program whose other subcommands do
/// not: `#[command(flatten)] on: DomainArgs`.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Common options")]
pub struct DomainArgs {
    /// First part of every topic name; several simulators on one machine need one each
    // It stands first among the common options.
    #[arg(long, display_order = 0, value_name = "NAME", default_value = DEFAULT_DOMAIN, value_parser = domain)]
    pub domain: String,
}

/// Flags of a binary that meets others on the bus in whatever it does:
/// `#[command(flatten)] common: CommonArgs`. The basic ones are reached through it.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Common options")]
pub struct CommonArgs {
    /// First part of every topic name; several simulators on one machine need one each
    #[arg(long, global = true, display_order = 0, value_name = "NAME", default_value = DEFAULT_DOMAIN, value_parser = domain)]
    pub domain: String,

    /// The flags that every binary has.
    #[command(flatten)]
    pub basic: BasicArgs,
}

impl Deref for CommonArgs {
    type Target = BasicArgs;

    fn deref(&self) -> &BasicArgs {
        &self.basic
    }
}

impl Default for CommonArgs {
    fn default() -> Self {
        BasicArgs::default().on(DEFAULT_DOMAIN)
    }
}

impl BasicArgs {
    /// These flags with a domain.
    pub fn on(&self, domain: &str) -> CommonArgs {
        CommonArgs {
            domain: domain.into(),
            basic: self.clone(),
        }
    }
}

/// Exit code of a process whose parent has ended; `exit::Exit` has the same.
const FAILED: i32 = 1;

/// Asks the kernel for a SIGTERM when the process `parent` ends, and ends if it has done so already.
fn end_with(parent: i32) {
    let asked = nix::sys::prctl::set_pdeathsig(nix::sys::signal::Signal::SIGTERM);
    if asked.is_err() || nix::unistd::getppid().as_raw() != parent {
        eprintln!("process {parent}, which started this one, has ended");
        std::process::exit(FAILED);
    }
}

const DOMAIN_RULE: &str = "a domain is 1 to 32 letters, digits, '_' or '-'";

/// A domain is the first part of a service name; `schema_bus` accepts the same characters.
fn domain(text: &str) -> Result<String, String> {
    let allowed = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if text.is_empty() || text.len() > 32 || !text.chars().all(allowed) {
        return Err(DOMAIN_RULE.into());
    }
    Ok(text.into())
}

/// What the environment says about the domain.
enum DomainVariable {
    Unset,
    Domain(String),
    Wrong(String),
}

impl DomainVariable {
    fn read(value: Option<OsString>) -> Self {
        match value.filter(|value| !value.is_empty()) {
            None => DomainVariable::Unset,
            Some(value) => match value.to_str().map(domain) {
                Some(Ok(name)) => DomainVariable::Domain(name),
                _ => DomainVariable::Wrong(value.to_string_lossy().into_owned()),
            },
        }
    }
}

const ENVIRONMENT: &str = "Environment:\n";
const DOMAIN_IN_ENVIRONMENT: &str = "  GANTRY_DOMAIN   the domain, unless --domain names one\n";
const LOG_IN_ENVIRONMENT: &str =
    "  RUST_LOG        which log lines are written, e.g. info,wgpu_hal=error; wins over -v and -q";
const EXIT_CODES: &str = "Exit codes:\n  0 done (also after Ctrl-C)   1 failed   2 wrong usage or launch file   3 finished but data was lost";

/// `T`'s command as users see it: with `completions`, `man`, the environment and the exit codes;
/// its own examples stay last.
pub fn command<T: CommandFactory>() -> clap::Command {
    command_in::<T>(&DomainVariable::Unset)
}

fn command_in<T: CommandFactory>(variable: &DomainVariable) -> clap::Command {
    let mut command = T::command();
    if let DomainVariable::Domain(name) = variable {
        // clap keeps defaults for as long as the program runs.
        command = on_domain(command, Box::leak(name.clone().into_boxed_str()));
    }
    let domain = if knows_domain(&command) {
        DOMAIN_IN_ENVIRONMENT
    } else {
        ""
    };
    let own = command
        .get_after_help()
        .map(|text| format!("\n\n{text}"))
        .unwrap_or_default();
    if !command.has_subcommands() {
        command = command.args_conflicts_with_subcommands(true);
    }
    let shell = clap::Arg::new("shell")
        .required(true)
        .value_parser(clap::value_parser!(clap_complete::Shell))
        .help("Shell to write for");
    let folder = clap::Arg::new("into")
        .long("into")
        .value_name("DIR")
        .value_parser(clap::value_parser!(std::path::PathBuf))
        .help("Write a page for the program and each of its subcommands into this folder");
    command
        .subcommand_negates_reqs(true)
        .subcommand(
            clap::Command::new("completions")
                .about("Print a completion script for a shell")
                .arg(shell)
                .display_order(900),
        )
        .subcommand(
            clap::Command::new("man")
                .about("Print the man page (troff), or write those of all subcommands")
                .arg(folder)
                .hide(true),
        )
        .max_term_width(110)
        .after_help(format!(
            "{ENVIRONMENT}{domain}{LOG_IN_ENVIRONMENT}\n\n{EXIT_CODES}{own}"
        ))
}

fn has_domain(command: &clap::Command) -> bool {
    command.get_arguments().any(|arg| arg.get_id() == "domain")
}

/// Whether the command or one of its subcommands takes a domain.
fn knows_domain(command: &clap::Command) -> bool {
    has_domain(command) || command.get_subcommands().any(knows_domain)
}

/// The command with another default domain, wherever it takes one.
fn on_domain(mut command: clap::Command, name: &'static str) -> clap::Command {
    if has_domain(&command) {
        command = command.mut_arg("domain", |arg| arg.default_value(name));
    }
    command.mut_subcommands(|sub| on_domain(sub, name))
}

/// Where the domain of the command that was called comes from; `None` if it takes none.
fn domain_source(command: &clap::Command, matches: &ArgMatches) -> Option<ValueSource> {
    // A word that is no subcommand is handed on together with the domain.
    if let Some((name, below)) = matches.subcommand()
        && let Some(called) = command.find_subcommand(name)
    {
        return domain_source(called, below);
    }
    match matches.try_contains_id("domain") {
        Ok(true) => matches.value_source("domain"),
        _ => None,
    }
}

/// The sentence for a domain in the environment that is none, if nothing else names the domain.
fn wrong_variable(
    variable: &DomainVariable,
    command: &clap::Command,
    matches: &ArgMatches,
) -> Option<String> {
    let DomainVariable::Wrong(value) = variable else {
        return None;
    };
    (domain_source(command, matches) == Some(ValueSource::DefaultValue)).then(|| {
        format!(
            "the environment's {DOMAIN_VARIABLE} is {value:?}, but {DOMAIN_RULE}; change it, or give --domain"
        )
    })
}

/// Parses the command line. Ends the process by itself for `--help`, `--version` (with `--verbose`
/// also commit and build), `completions`, `man`, `--check-arguments` and wrong usage (exit code 2).
pub fn parse<T: Parser>() -> T {
    let variable = DomainVariable::read(std::env::var_os(DOMAIN_VARIABLE));
    let mut command = command_in::<T>(&variable);
    if build_info::asked_verbosely(std::env::args_os().skip(1)) {
        // clap keeps it for as long as the program runs.
        command = command.version(&*build_info::verbose_version().leak());
    }
    let mut matches = command.clone().get_matches();
    if let Some(message) = wrong_variable(&variable, &command, &matches) {
        command
            .error(clap::error::ErrorKind::ValueValidation, message)
            .exit()
    }
    match matches.subcommand() {
        Some(("completions", sub)) => {
            let shell: clap_complete::Shell =
                *sub.get_one("shell").expect("clap requires the shell");
            let name = command.get_name().to_owned();
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut command, name, &mut script);
            print_and_exit(&script)
        }
        Some(("man", sub)) => match sub.get_one::<std::path::PathBuf>("into") {
            None => print_and_exit(&man::page(command)),
            Some(folder) => match man::write(command, folder) {
                Ok(files) => {
                    let lines = files.iter().map(|file| format!("{}\n", file.display()));
                    print_and_exit(lines.collect::<String>().as_bytes())
                }
                Err(error) => {
                    eprintln!(
                        "error: cannot write man pages into {}: {error}",
                        folder.display()
                    );
                    std::process::exit(FAILED)
                }
            },
        },
        _ => {
            let only_check = matches!(
                matches.try_get_one::<bool>("check_arguments"),
                Ok(Some(true))
            );
            let args = T::from_arg_matches_mut(&mut matches)
                .unwrap_or_else(|error| error.format(&mut command).exit());
            match only_check {
                true => print_and_exit(b""),
                false => args,
            }
        }
    }
}

/// A reader that stops reading early (`| head`) counts as success.
fn print_and_exit(bytes: &[u8]) -> ! {
    let written = std::io::stdout().write_all(bytes);
    let failed = written.is_err_and(|error| error.kind() != std::io::ErrorKind::BrokenPipe);
    std::process::exit(failed.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Parser)]
    #[command(
        name = "gantry-probe",
        after_help = "Examples:\n  gantry-probe --must x"
    )]
    struct Probe {
        #[command(flatten)]
        common: CommonArgs,
        #[arg(long)]
        must: String,
    }

    fn probe(words: &[&str]) -> Result<Probe, clap::Error> {
        let mut matches = command::<Probe>().try_get_matches_from(words)?;
        <Probe as clap::FromArgMatches>::from_arg_matches_mut(&mut matches)
    }

    #[test]
    fn the_command_is_well_formed_and_its_examples_come_last() {
        let mut command = command::<Probe>();
        command.clone().debug_assert();
        let help = command.render_long_help().to_string();
        assert!(help.trim_end().ends_with("gantry-probe --must x"), "{help}");
        assert!(
            help.contains("RUST_LOG") && help.contains("completions"),
            "{help}"
        );
    }

    #[test]
    fn completions_do_not_need_the_required_flags() {
        assert!(
            command::<Probe>()
                .try_get_matches_from(["gantry-probe", "completions", "bash"])
                .is_ok()
        );
    }

    #[test]
    fn defaults_are_those_of_the_flags() {
        let args =
            probe(&["gantry-probe", "--must", "x"]).unwrap_or_else(|error| panic!("{error}"));
        let common = CommonArgs::default();
        assert_eq!(args.common.domain, common.domain);
        assert_eq!(
            (args.common.color, args.common.log_format),
            (common.color, common.log_format)
        );
        assert_eq!(args.must, "x");
    }

    /// The domain that `words` mean, or the sentence, where the environment has this variable.
    fn domain_of(variable: Option<&str>, words: &[&str]) -> Result<String, String> {
        let variable = DomainVariable::read(variable.map(OsString::from));
        let words = [&["gantry-probe", "--must", "x"], words].concat();
        let command = command_in::<Probe>(&variable);
        let mut matches = command
            .clone()
            .try_get_matches_from(words)
            .map_err(|error| error.to_string())?;
        if let Some(message) = wrong_variable(&variable, &command, &matches) {
            return Err(message);
        }
        let probe = <Probe as clap::FromArgMatches>::from_arg_matches_mut(&mut matches);
        Ok(probe.map_err(|error| error.to_string())?.common.domain)
    }

    #[test]
    fn the_environment_names_the_domain_where_no_flag_does() {
        assert_eq!(domain_of(None, &[]).as_deref(), Ok("gantry"));
        assert_eq!(domain_of(Some(""), &[]).as_deref(), Ok("gantry"));
        assert_eq!(domain_of(Some("lab"), &[]).as_deref(), Ok("lab"));
        let flag = ["--domain", "gantry"];
        assert_eq!(domain_of(Some("lab"), &flag).as_deref(), Ok("gantry"));
        assert_eq!(domain_of(Some("a b"), &flag).as_deref(), Ok("gantry"));
        assert_eq!(
            domain_of(Some("a b"), &[]).unwrap_err(),
            "the environment's GANTRY_DOMAIN is \"a b\", but a domain is 1 to 32 letters, digits, '_' or '-'; change it, or give --domain"
        );
    }

    #[derive(Parser)]
    #[command(name = "gantry-words")]
    struct Words {
        #[command(subcommand)]
        word: Word,
        #[command(flatten)]
        _basic: BasicArgs,
    }

    #[derive(clap::Subcommand)]
    enum Word {
        /// Reads the bus
        Watch(DomainArgs),
        /// Reads a file
        Show,
    }

    #[test]
    fn a_subcommand_without_a_domain_heeds_none() {
        let words = |variable: &str, words: &[&str]| -> Result<Option<String>, String> {
            let variable = DomainVariable::read(Some(OsString::from(variable)));
            let command = command_in::<Words>(&variable);
            let words = [&["gantry-words"], words].concat();
            let mut matches = command
                .clone()
                .try_get_matches_from(words)
                .map_err(|error| error.to_string())?;
            if let Some(message) = wrong_variable(&variable, &command, &matches) {
                return Err(message);
            }
            let read = <Words as clap::FromArgMatches>::from_arg_matches_mut(&mut matches);
            match read.map_err(|error| error.to_string())?.word {
                Word::Watch(on) => Ok(Some(on.domain)),
                Word::Show => Ok(None),
            }
        };
        assert_eq!(words("lab", &["watch"]), Ok(Some("lab".into())));
        let flag = ["watch", "--domain", "other"];
        assert_eq!(words("a b", &flag), Ok(Some("other".into())));
        assert!(
            words("a b", &["watch"])
                .unwrap_err()
                .contains("GANTRY_DOMAIN")
        );
        assert_eq!(words("a b", &["show", "-v"]), Ok(None));
        let refused = words("lab", &["show", "--domain", "lab"]).unwrap_err();
        assert!(
            refused.contains("unexpected argument '--domain'"),
            "{refused}"
        );
        let mut command = command::<Words>();
        let help = command.render_long_help().to_string();
        assert!(
            !help.contains("--domain <NAME>") && help.contains("GANTRY_DOMAIN"),
            "{help}"
        );
        let mut command = command.find_subcommand("watch").expect("it is one").clone();
        assert!(
            command
                .render_help()
                .to_string()
                .contains("--domain <NAME>")
        );
    }

    #[test]
    fn a_domain_with_a_slash_is_refused() {
        for bad in ["a/b", "", &"x".repeat(33), "a b"] {
            assert!(
                probe(&["gantry-probe", "--must", "x", "--domain", bad]).is_err(),
                "{bad:?}"
            );
        }
    }
}
