//! `gantry topic`: lists topics, measures their rate, size and delay, and prints their content. It
//! reads like any consumer.

mod echo;
mod echo_result;
mod fields;
mod info;
mod measure;
mod statistics;

pub use info::document;

use launch_cli::{CommonArgs, Exit};
use schema_bus::Bus;

use crate::cli::{Form, TopicArgs, TopicWord};
use crate::look::top::{self, Tables};

pub fn run(args: &TopicArgs, common: &CommonArgs) -> anyhow::Result<Exit> {
    let bus = Bus::open(&common.domain, "gantry-topic")?;
    // Otherwise topics of killed writers would be listed as alive.
    bus.clean_dead_nodes();
    let short = |topic: &str| {
        topic
            .strip_prefix(&format!("{}/", common.domain))
            .unwrap_or(topic)
            .to_owned()
    };
    match &args.word {
        TopicWord::List(list) => info::list(&bus, Form::of(list.json)),
        TopicWord::Info(one) => info::info(&bus, &short(&one.topic), Form::of(one.json)),
        TopicWord::Hz(window) => {
            measure::run(&bus, &short(&window.topic), window, measure::What::Rate)
        }
        TopicWord::Bw(window) => measure::run(
            &bus,
            &short(&window.topic),
            window,
            measure::What::Bandwidth,
        ),
        TopicWord::Delay(window) => {
            measure::run(&bus, &short(&window.topic), window, measure::What::Age)
        }
        TopicWord::Echo(echo) => echo::run(&bus, &short(&echo.topic), echo),
        TopicWord::Top(top) => {
            drop(bus);
            top::run(top, Tables::Topics, common)
        }
    }
}
