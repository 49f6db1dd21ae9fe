//! What the doctor found: one thing, how bad it is, and what to do about it.

/// How bad a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    Ok,
    /// Something is slow, or something optional is missing.
    Warn,
    /// The simulator will not run.
    Fail,
}

impl Grade {
    /// Name in the output.
    pub fn name(self) -> &'static str {
        match self {
            Grade::Ok => "ok",
            Grade::Warn => "warn",
            Grade::Fail => "fail",
        }
    }
}

/// One thing that was examined.
#[derive(Debug)]
pub struct Finding {
    pub what: &'static str,
    pub grade: Grade,
    pub text: String,
    /// How to repair it; empty if there is nothing to do.
    pub fix: String,
}

/// Whether text for the terminal carries colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colour {
    Plain,
    Ansi,
}

impl Finding {
    pub fn ok(what: &'static str, text: impl Into<String>) -> Self {
        Finding {
            what,
            grade: Grade::Ok,
            text: text.into(),
            fix: String::new(),
        }
    }

    pub fn warn(what: &'static str, text: impl Into<String>, fix: impl Into<String>) -> Self {
        Finding {
            what,
            grade: Grade::Warn,
            text: text.into(),
            fix: fix.into(),
        }
    }

    pub fn fail(what: &'static str, text: impl Into<String>, fix: impl Into<String>) -> Self {
        Finding {
            what,
            grade: Grade::Fail,
            text: text.into(),
            fix: fix.into(),
        }
    }

    /// One line, and a second one with the remedy if there is one.
    pub fn as_text(&self, colour: Colour) -> String {
        let name = self.grade.name();
        let mark = match (colour, self.grade) {
            (Colour::Plain, _) => format!("{name:<4}"),
            (Colour::Ansi, Grade::Ok) => format!("\x1b[32m{name:<4}\x1b[0m"),
            (Colour::Ansi, Grade::Warn) => format!("\x1b[33m{name:<4}\x1b[0m"),
            (Colour::Ansi, Grade::Fail) => format!("\x1b[31m{name:<4}\x1b[0m"),
        };
        let fix = if self.fix.is_empty() {
            String::new()
        } else {
            format!("{:23}→ {}\n", "", self.fix)
        };
        format!("{mark}  {:<15}  {}\n{fix}", self.what, self.text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_finding_has_its_remedy_below_it() {
        let finding = Finding::fail("shared memory", "64 MiB", "docker run --shm-size=2g");
        let text = finding.as_text(Colour::Plain);
        assert_eq!(
            text,
            "fail  shared memory    64 MiB\n                       → docker run --shm-size=2g\n"
        );
        assert_eq!(
            Finding::ok("python", "3.11")
                .as_text(Colour::Plain)
                .lines()
                .count(),
            1
        );
    }
}
