//! Signs of life on stderr for work that takes longer than two seconds. They are drawn on terminals
//! only: a pipe, a file or a log gets nothing, and neither does anybody under `--quiet`.
//!
//! A bar vanishes when it is dropped; what was done is said by the program itself.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::args::BasicArgs;

/// Time between two pictures of a spinner.
const SPIN: Duration = Duration::from_millis(200);

/// What a program draws while its user waits.
#[derive(Debug)]
pub struct Progress(ProgressBar);

impl Progress {
    /// A bar over `total` steps, labelled with what is being done; `unit` names several steps.
    pub fn steps(basic: &BasicArgs, what: &str, total: u64, unit: &str) -> Self {
        let template = format!("{{msg}} {{wide_bar}} {{pos}}/{{len}} {unit}, {{eta}} left");
        Progress::with(basic, ProgressBar::new(total), &template, what)
    }

    /// A bar over `total` bytes, labelled with what is being done.
    pub fn bytes(basic: &BasicArgs, what: &str, total: u64) -> Self {
        let template = "{msg} {wide_bar} {bytes}/{total_bytes}, {eta} left";
        Progress::with(basic, ProgressBar::new(total), template, what)
    }

    /// A spinner with the time that has passed, for work whose amount nobody knows.
    pub fn endless(basic: &BasicArgs, what: &str) -> Self {
        let bar = ProgressBar::new_spinner();
        let progress = Progress::with(basic, bar, "{spinner} {msg} {elapsed}", what);
        progress.0.enable_steady_tick(SPIN);
        progress
    }

    fn with(basic: &BasicArgs, bar: ProgressBar, template: &str, what: &str) -> Self {
        if basic.quiet > 0 {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        bar.set_style(ProgressStyle::with_template(template).expect("the template is constant"));
        bar.set_message(what.to_owned());
        Progress(bar)
    }

    /// Counts `steps` more as done.
    pub fn add(&self, steps: u64) {
        self.0.inc(steps);
    }

    /// So many steps are done in all.
    pub fn set(&self, steps: u64) {
        self.0.set_position(steps);
    }

    /// Names what is done now.
    pub fn say(&self, what: impl Into<String>) {
        self.0.set_message(what.into());
    }

    /// Takes the bar away while `print` writes on the terminal.
    pub fn hidden_while<T>(&self, print: impl FnOnce() -> T) -> T {
        self.0.suspend(print)
    }

    /// How many steps are done.
    pub fn done(&self) -> u64 {
        self.0.position()
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_counted_where_nothing_is_drawn() {
        let basic = BasicArgs {
            quiet: 1,
            ..BasicArgs::default()
        };
        let bar = Progress::steps(&basic, "reading", 10, "files");
        bar.add(3);
        bar.say("writing");
        bar.add(1);
        assert_eq!(bar.done(), 4);
        bar.set(9);
        assert_eq!(bar.done(), 9);
        assert!(bar.0.is_hidden());
        Progress::endless(&basic, "waiting").add(1);
        assert_eq!(Progress::bytes(&basic, "copying", 5).done(), 0);
    }
}
