//! `[process.NAME.params]` as JSON: a file in the folder of the run, and an argument.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use launch_spec::Process;
use serde_json::Value as Json;
use toml::Value as Toml;

/// A process's settings, ready to be handed over.
#[derive(Debug)]
pub struct Params {
    text: String,
    file: PathBuf,
}

impl Params {
    /// Writes the settings into `NAME.params.json` in the folder of the run; `None` if the process
    /// has none.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn of(
        process: &Process,
        run_dir: &Path,
        replaced: &dyn Fn(&str) -> String,
    ) -> anyhow::Result<Option<Params>> {
        let Some(params) = &process.params else {
            return Ok(None);
        };
        let json = json(&Toml::Table(params.clone()), replaced);
        let text = json.to_string();
        let file = run_dir.join(format!("{}.params.json", process.name));
        std::fs::write(&file, format!("{json:#}\n"))
            .with_context(|| format!("cannot write {}", file.display()))?;
        Ok(Some(Params { text, file }))
    }

    /// Replaces `${params}` by the JSON text and `${params_file}` by the path of the file. If no
    /// argument has either, the text becomes the last argument.
    pub fn hand_over(&self, args: &mut Vec<String>) {
        let is_wanted = args.iter().any(|arg| arg.contains("${params"));
        if !is_wanted {
            args.push(self.text.clone());
        }
        for arg in args.iter_mut().filter(|_| is_wanted) {
            *arg = arg
                .replace("${params_file}", &self.file.to_string_lossy())
                .replace("${params}", &self.text);
        }
    }
}

/// A TOML value as JSON; dates become texts.
fn json(value: &Toml, replaced: &dyn Fn(&str) -> String) -> Json {
    match value {
        Toml::String(text) => Json::from(replaced(text)),
        Toml::Integer(number) => Json::from(*number),
        Toml::Float(number) => Json::from(*number),
        Toml::Boolean(flag) => Json::from(*flag),
        Toml::Datetime(time) => Json::from(time.to_string()),
        Toml::Array(list) => list.iter().map(|element| json(element, replaced)).collect(),
        Toml::Table(table) => Json::Object(
            table
                .iter()
                .map(|(key, value)| (key.clone(), json(value, replaced)))
                .collect(),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args_of(cmd: &str, dir: &Path) -> Vec<String> {
        let text = format!(
            "version = 1\n[process.a]\ncmd = {cmd}\n[process.a.params]\nlow = 0.5\nn = 3\non = true\nwhen = 2026-01-31\nout = \"${{run_dir}}/x\"\nlist = [1, {{ b = \"c\" }}]\n"
        );
        let launch = launch_spec::Launch::parse(&text, "x").unwrap_or_else(|e| panic!("{e}"));
        let process = launch.process("a").unwrap();
        let replaced = |text: &str| text.replace("${run_dir}", "D");
        let params = Params::of(process, dir, &replaced).unwrap().unwrap();
        let mut args = process.cmd[1..].to_vec();
        params.hand_over(&mut args);
        args
    }

    #[test]
    fn settings_are_the_last_argument_unless_the_command_says_where_they_go() {
        let dir = tempfile::tempdir().unwrap();
        let expected = serde_json::json!({
            "low": 0.5, "n": 3, "on": true, "when": "2026-01-31", "out": "D/x", "list": [1, {"b": "c"}]
        });
        let last = args_of("[\"p\", \"x\"]", dir.path());
        assert_eq!((last.len(), last[0].as_str()), (2, "x"));
        assert_eq!(last[1].parse::<Json>().unwrap(), expected);
        let inside = args_of("[\"p\", \"--params=${params}\", \"x\"]", dir.path());
        let text = inside[0].strip_prefix("--params=").unwrap();
        assert_eq!(
            (inside.len(), text.parse::<Json>().unwrap()),
            (2, expected.clone())
        );
        let file = args_of("[\"p\", \"--file\", \"${params_file}\"]", dir.path());
        assert_eq!(file.len(), 2);
        let text = std::fs::read_to_string(&file[1]).unwrap();
        assert_eq!(text.parse::<Json>().unwrap(), expected);
    }
}
