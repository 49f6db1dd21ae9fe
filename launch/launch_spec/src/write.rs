//! A launch as text with every default filled in.

use toml::{Table, Value};

use crate::fill::table_of;
use crate::model::{Launch, Rig, Sensor};
use crate::parse::VERSION;
use crate::process::{Process, ReadyWhen};

impl Launch {
    /// The whole file with every default filled in; [`Launch::parse`] reads it back to the same
    /// value.
    pub fn to_toml_with_defaults(&self) -> String {
        let mut text = format!("version = {VERSION}\n");
        let mut section = |path: &[&str], table: Table| {
            let nested = path.iter().rev().fold(Value::Table(table), |inner, key| {
                Value::Table(Table::from_iter([((*key).to_owned(), inner)]))
            });
            let written = toml::to_string(&nested).expect("TOML values can be written as TOML");
            text.push('\n');
            text.push_str(&written);
        };
        section(&["scenario"], table_of(&self.scenario));
        section(&["ego"], table_of(&self.ego));
        for (name, rig) in &self.rigs {
            section(&["rig", name], rig_table(rig));
        }
        for (name, sensor) in &self.sensors {
            section(&["sensor", name], sensor_table(sensor));
        }
        for process in &self.processes {
            section(&["process", &process.name], process_table(process));
        }
        text
    }
}

fn rig_table(rig: &Rig) -> Table {
    let (key, value) = match rig {
        Rig::Ego => ("vehicle", Value::from("ego")),
        Rig::Other(idx) => ("vehicle", Value::from(i64::from(*idx))),
        Rig::Free(pose) => ("pose", Value::Table(table_of(pose))),
    };
    Table::from_iter([(key.to_owned(), value)])
}

fn sensor_table(sensor: &Sensor) -> Table {
    let mut table = table_of(&sensor.spec);
    let rig = match &sensor.rigs[..] {
        [one] => Value::from(one.as_str()),
        several => Value::from(several.to_vec()),
    };
    table.insert("rig".into(), rig);
    table
}

fn process_table(process: &Process) -> Table {
    let mut table = Table::new();
    table.insert("cmd".into(), Value::from(process.cmd.clone()));
    table.insert("required".into(), Value::from(process.required));
    table.insert("after".into(), Value::from(process.after.clone()));
    table.insert(
        "cpus".into(),
        Value::from(
            process
                .cpus
                .iter()
                .map(|cpu| i64::from(*cpu))
                .collect::<Vec<_>>(),
        ),
    );
    table.insert("restart".into(), Value::Table(table_of(&process.restart)));
    table.insert("stop".into(), Value::Table(table_of(&process.stop)));
    table.insert(
        "env".into(),
        Value::Table(
            process
                .env
                .iter()
                .map(|(key, value)| (key.clone(), Value::from(value.as_str())))
                .collect(),
        ),
    );
    if let Some(ready) = &process.ready {
        let (key, sign) = match &ready.when {
            ReadyWhen::Service(topic) => ("service", topic),
            ReadyWhen::Line(pattern) => ("line", pattern),
            ReadyWhen::Tcp(address) => ("tcp", address),
        };
        let entries = [
            (key.to_owned(), Value::from(sign.as_str())),
            ("within".to_owned(), Value::from(ready.within.to_string())),
        ];
        table.insert("ready".into(), Value::Table(entries.into_iter().collect()));
    }
    table
}
