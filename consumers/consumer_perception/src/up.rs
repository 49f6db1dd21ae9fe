//! A program's process in the launch file that is made for a run.

use toml::{Table, Value};

use crate::suite::ProgramProcess;

/// `[process.NAME]` of a program's process. With a name in lockstep it is told to join under it, by
/// a key of its settings.
pub fn process_table(process: &ProgramProcess, lockstep: bool, after: &[&str]) -> Table {
    let mut table = Table::new();
    let texts = |all: &[String]| Value::Array(all.iter().map(|it| it.clone().into()).collect());
    table.insert("cmd".into(), texts(&process.cmd));
    for (key, folder) in [("cwd", &process.cwd), ("venv", &process.venv)] {
        if let Some(folder) = folder {
            table.insert(key.into(), folder.display().to_string().into());
        }
    }
    let mut env: Table = process
        .env
        .iter()
        .map(|(key, value)| (key.clone(), value.clone().into()))
        .collect();
    if let Some(gpu) = &process.gpu {
        env.insert("CUDA_VISIBLE_DEVICES".into(), gpu.clone().into());
    }
    if !env.is_empty() {
        table.insert("env".into(), env.into());
    }
    let mut params = process.params.clone();
    if lockstep {
        let params = params.get_or_insert_default();
        params.insert("lockstep".into(), process.name.clone().into());
    }
    if let Some(params) = params {
        table.insert("params".into(), params.into());
    }
    if !process.cores.is_empty() {
        table.insert("cores".into(), cores(&process.cores));
    }
    if let Some(nice) = process.nice {
        table.insert("nice".into(), i64::from(nice).into());
    }
    if let Some(restart) = process.restart
        && let Ok(restart) = Value::try_from(restart)
    {
        table.insert("restart".into(), restart);
    }
    table.insert(
        "after".into(),
        Value::Array(after.iter().map(|name| (*name).into()).collect()),
    );
    table
}

/// A list of cores as launch files have it.
pub fn cores(cores: &[u32]) -> Value {
    Value::Array(cores.iter().map(|core| i64::from(*core).into()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_of_a_launch_file_says_all_that_the_suite_does() {
        let text = "cmd = [\"python\", \"a.py\"]\ncwd = \"x\"\ncores = [1]\nnice = 5\ngpu = \"0\"\nparams = { a = 1 }\nrestart = { policy = \"on-failure\" }\n";
        let suite = format!("{}[program.other]\n{text}", crate::suite::tests::SMALL);
        let suite = crate::suite::tests::read(&suite).unwrap();
        let process = &suite.program("other").unwrap().processes[0];
        let table = process_table(process, true, &["replay"]);
        let mut launch: Table = "version = 1\n[process.replay]\ncmd = [\"gantry-replay\"]\n"
            .parse()
            .unwrap();
        launch["process"]
            .as_table_mut()
            .unwrap()
            .insert("other".into(), table.into());
        let text = toml::to_string(&launch).unwrap();
        let read = launch_spec::Launch::parse(&text, "made").unwrap();
        let made = read.process("other").unwrap();
        assert_eq!((made.nice, made.cores.as_slice()), (Some(5), &[1][..]));
        assert_eq!(made.env["CUDA_VISIBLE_DEVICES"], "0");
        let params = made.params.as_ref().unwrap();
        assert_eq!(params["lockstep"].as_str(), Some("other"));
        assert_eq!(params["a"].as_integer(), Some(1));
    }
}
