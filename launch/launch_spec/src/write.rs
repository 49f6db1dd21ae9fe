//! A launch as text with every default filled in.

use toml::{Table, Value};

use crate::batch::Batch;
use crate::files::VERSION;
use crate::fill::table_of;
use crate::model::{Launch, Rig, Sensor};
use crate::process::{Process, ReadyWhen};
use crate::topic::Topic;

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
        section(&["spectator"], table_of(&self.spectator));
        for (name, rig) in &self.rigs {
            section(&["rig", name], rig_table(rig));
        }
        for (name, sensor) in &self.sensors {
            section(&["sensor", name], sensor_table(sensor));
        }
        for (name, batch) in &self.batches {
            section(&["batch", name], batch_table(batch));
        }
        for (name, topic) in &self.topics {
            section(&["topic", name], topic_table(topic));
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

fn batch_table(batch: &Batch) -> Table {
    let modalities: Vec<&str> = batch.modalities.iter().map(|it| it.name()).collect();
    Table::from_iter([
        ("cameras".to_owned(), Value::from(batch.cameras.clone())),
        ("modalities".to_owned(), Value::from(modalities)),
    ])
}

fn topic_table(topic: &Topic) -> Table {
    let limits = &topic.limits;
    let numbers = [
        ("readers", limits.readers.map(i64::from)),
        ("buffer", limits.buffer.map(i64::from)),
        ("borrowed", limits.borrowed.map(i64::from)),
        ("gpu_readers", limits.gpu_readers.map(i64::from)),
        ("max_bytes", topic.max_bytes.map(|bytes| bytes as i64)),
    ];
    numbers
        .into_iter()
        .filter_map(|(key, number)| Some((key.to_owned(), Value::from(number?))))
        .chain(limits.gpu.then(|| ("gpu".to_owned(), Value::from(true))))
        .chain(
            topic
                .result
                .map(|result| ("type".to_owned(), Value::from(result.name()))),
        )
        .collect()
}

fn process_table(process: &Process) -> Table {
    let mut table = Table::new();
    table.insert("cmd".into(), Value::from(process.cmd.clone()));
    table.insert("required".into(), Value::from(process.required));
    table.insert("after".into(), Value::from(process.after.clone()));
    table.insert(
        "cores".into(),
        Value::from(
            process
                .cores
                .iter()
                .map(|core| i64::from(*core))
                .collect::<Vec<_>>(),
        ),
    );
    table.insert("lockstep".into(), Value::from(process.lockstep));
    for (key, path) in [("cwd", &process.cwd), ("venv", &process.venv)] {
        if let Some(path) = path {
            table.insert(key.into(), Value::from(path.to_string_lossy().into_owned()));
        }
    }
    if let Some(nice) = process.nice {
        table.insert("nice".into(), Value::from(i64::from(nice)));
    }
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
        let sign = match &ready.when {
            ReadyWhen::Service(topic) => Some(("service", topic)),
            ReadyWhen::Line(pattern) => Some(("line", pattern)),
            ReadyWhen::Tcp(address) => Some(("tcp", address)),
            ReadyWhen::Lockstep => None,
        };
        let entries = sign
            .map(|(key, sign)| (key.to_owned(), Value::from(sign.as_str())))
            .into_iter()
            .chain([("within".to_owned(), Value::from(ready.within.to_string()))]);
        table.insert("ready".into(), Value::Table(entries.collect()));
    }
    if let Some(params) = &process.params {
        table.insert("params".into(), Value::Table(params.clone()));
    }
    table
}
