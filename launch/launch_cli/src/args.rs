//! Flags and subcommands that every binary has: the common options, `completions <shell>` and the
//! hidden `man`.

use std::io::Write as _;

use clap::{ArgAction, Args, CommandFactory, Parser};

use crate::logging::{self, ColorWhen, LogFormat, LogOptions};

/// Flags shared by all binaries: `#[command(flatten)] common: CommonArgs`.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Common options")]
pub struct CommonArgs {
    /// First part of every topic name; several simulators on one machine need one each
    #[arg(long, global = true, value_name = "NAME", default_value = "gantry", value_parser = domain)]
    pub domain: String,

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
}

impl CommonArgs {
    /// Starts logging to stderr as these flags ask; call once, before anything logs.
    pub fn init_logging(&self) {
        logging::init(&LogOptions {
            verbose: self.verbose,
            quiet: self.quiet,
            color: self.color,
            format: self.log_format,
        });
    }
}

impl Default for CommonArgs {
    fn default() -> Self {
        CommonArgs {
            domain: "gantry".into(),
            verbose: 0,
            quiet: 0,
            color: ColorWhen::Auto,
            log_format: LogFormat::Text,
        }
    }
}

/// A domain is the first part of a service name; `schema_bus` accepts the same characters.
fn domain(text: &str) -> Result<String, String> {
    let allowed = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if text.is_empty() || text.len() > 32 || !text.chars().all(allowed) {
        return Err("a domain is 1 to 32 letters, digits, '_' or '-'".into());
    }
    Ok(text.into())
}

const ENVIRONMENT: &str = "Environment:\n  RUST_LOG    which log lines are written, e.g. info,wgpu_hal=error; wins over -v and -q";
const EXIT_CODES: &str = "Exit codes:\n  0 done (also after Ctrl-C)   1 failed   2 wrong usage or launch file   3 finished but data was lost";

/// `T`'s command as users see it: with `completions`, `man`, the environment and the exit codes;
/// its own examples stay last.
pub fn command<T: CommandFactory>() -> clap::Command {
    let mut command = T::command();
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
                .about("Print the man page (troff)")
                .hide(true),
        )
        .max_term_width(110)
        .after_help(format!("{ENVIRONMENT}\n\n{EXIT_CODES}{own}"))
}

/// Parses the command line. Ends the process by itself for `--help`, `--version`, `completions`,
/// `man` and wrong usage (exit code 2).
pub fn parse<T: Parser>() -> T {
    let mut command = command::<T>();
    let mut matches = command.clone().get_matches();
    match matches.subcommand() {
        Some(("completions", sub)) => {
            let shell: clap_complete::Shell =
                *sub.get_one("shell").expect("clap requires the shell");
            let name = command.get_name().to_owned();
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut command, name, &mut script);
            print_and_exit(&script)
        }
        Some(("man", _)) => {
            let mut page = Vec::new();
            clap_mangen::Man::new(command)
                .render(&mut page)
                .expect("writing to memory does not fail");
            print_and_exit(&page)
        }
        _ => T::from_arg_matches_mut(&mut matches)
            .unwrap_or_else(|error| error.format(&mut command).exit()),
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
        assert_eq!(
            (
                args.common.domain,
                args.common.color,
                args.common.log_format
            ),
            (common.domain, common.color, common.log_format)
        );
        assert_eq!(args.must, "x");
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
