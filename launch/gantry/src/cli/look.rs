//! Words that look at what runs: `topic`, `top` and `graph`.

use std::path::PathBuf;
use std::str::FromStr;

use clap::Subcommand;
use launch_spec::Period;

const TOPIC_EXAMPLES: &str = "\
A topic may be written with or without the domain: gantry/ego/front/rgb or ego/front/rgb.
hz, bw, delay and echo read like any consumer: they take one of the topic's places for readers, \
and a sensor that nobody else reads begins to render. list, info and top only look.

Examples:
  gantry topic list
  gantry topic hz ego/front/rgb --window 5s
  gantry topic delay people/boxes --once --json
  gantry topic echo world/snapshot --once --json";

/// `gantry topic`.
#[derive(clap::Args, Debug, Clone)]
#[command(after_help = TOPIC_EXAMPLES)]
pub struct TopicArgs {
    #[command(subcommand)]
    pub word: TopicWord,
}

/// What to find out about topics.
#[derive(Subcommand, Debug, Clone)]
pub enum TopicWord {
    /// All topics of the domain with their types, who writes them, and how many read
    List(ListArgs),
    /// One topic: type, schema version, sizes, limits, who is there
    Info(OneTopic),
    /// Rate, jitter and losses of a topic over a window
    Hz(WindowArgs),
    /// Bytes per second and per sample of a topic over a window
    Bw(WindowArgs),
    /// Age of samples when they arrive here (publisher's clock to ours, same machine), and of
    /// results the time since their inputs were published
    Delay(WindowArgs),
    /// Headers and contents as text, or one JSON object per line
    Echo(EchoArgs),
    /// All topics on a screen of their own: `gantry top` without processes
    Top(TopArgs),
}

/// `gantry topic list`.
#[derive(clap::Args, Debug, Clone)]
pub struct ListArgs {
    /// Print one JSON object per line
    #[arg(long)]
    pub json: bool,
}

/// A topic.
#[derive(clap::Args, Debug, Clone)]
pub struct OneTopic {
    /// Topic, e.g. ego/front/rgb
    pub topic: String,
    /// Print a JSON object
    #[arg(long)]
    pub json: bool,
}

/// A topic and how long to watch it.
#[derive(clap::Args, Debug, Clone)]
pub struct WindowArgs {
    /// Topic, e.g. ego/front/rgb
    pub topic: String,
    /// Length of a measurement
    #[arg(long, value_name = "TIME", value_parser = Period::from_str, default_value = "3s")]
    pub window: Period,
    /// Number of measurements [default: until Ctrl-C]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub count: Option<u64>,
    /// Measure once; the same as --count 1
    #[arg(long, conflicts_with = "count")]
    pub once: bool,
    /// Print one JSON object per measurement
    #[arg(long)]
    pub json: bool,
}

/// `gantry topic echo`.
#[derive(clap::Args, Debug, Clone)]
pub struct EchoArgs {
    /// Topic, e.g. ego/front/rgb
    pub topic: String,
    /// Stop after this many [default: until Ctrl-C]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub count: Option<u64>,
    /// Stop after the first; the same as --count 1
    #[arg(long, conflicts_with = "count")]
    pub once: bool,
    /// List elements to print of each sample, at most
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub elements: usize,
    /// Print one JSON object per sample
    #[arg(long)]
    pub json: bool,
}

const TOP_NOTES: &str = "\
Rates, ages and bandwidths come from the headers in the writers' memory: nothing is read as a \
consumer would, so nothing starts to render and no reader's place is taken. Losses, jitter and delay \
are known only of topics that top reads itself (--measure, or m on the screen); what other readers \
lose cannot be seen from outside. A topic's last free place is never taken.

Keys:
  q quit   Tab next table   arrows, PgUp, PgDn, Home, End select   Enter details   g who reads what
  s sort   r reverse   / filter   p pause   m measure, M also if that starts a sensor   + - pace   ? help

Examples:
  gantry top
  gantry top --sort bw --filter ego/
  gantry top --once --json | jq '.topics[] | {topic, rate_hz}'";

/// `gantry top`.
#[derive(clap::Args, Debug, Clone)]
#[command(after_help = TOP_NOTES)]
pub struct TopArgs {
    /// Print one screen as plain text and end
    #[arg(long)]
    pub once: bool,
    /// Print a JSON object instead: one with --once, else one every interval
    #[arg(long)]
    pub json: bool,
    /// Time between two looks
    #[arg(long, value_name = "TIME", value_parser = pace, default_value = "1s")]
    pub every: Period,
    /// Order of the topics
    #[arg(long, value_enum, value_name = "COLUMN", default_value_t = Column::Name)]
    pub sort: Column,
    /// Show only topics and processes whose name or type contains this
    #[arg(
        long,
        value_name = "TEXT",
        default_value = "",
        hide_default_value = true
    )]
    pub filter: String,
    /// Read this topic, for its losses, jitter and delay; may be repeated
    #[arg(long, value_name = "TOPIC")]
    pub measure: Vec<String>,
}

/// Column that topics are sorted by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Column {
    /// By name.
    #[default]
    Name,
    /// By type, then by name.
    Type,
    /// Fastest first.
    Rate,
    /// Oldest first.
    Age,
    /// Most bytes per second first.
    Bw,
    /// Most losses first.
    Lost,
    /// Most readers first.
    Readers,
}

impl Column {
    /// The next one, and after the last the first.
    pub fn next(self) -> Column {
        use Column::*;
        match self {
            Name => Type,
            Type => Rate,
            Rate => Age,
            Age => Bw,
            Bw => Lost,
            Lost => Readers,
            Readers => Name,
        }
    }
}

/// A time between looks.
fn pace(text: &str) -> Result<Period, String> {
    let period = Period::from_str(text).map_err(|error| error.to_string())?;
    let allowed = 0.1..=3600.0;
    match allowed.contains(&period.duration().as_secs_f64()) {
        true => Ok(period),
        false => Err("must be 100ms to 1h".into()),
    }
}

const GRAPH_NOTES: &str = "\
Without --svg, --dot or --json the graph is printed as text. The picture joins topics of the same \
writers and readers into one box unless --all is given; controls to the simulator are dashed. \
FILE may be - for stdout.

Examples:
  gantry graph
  gantry graph --svg graph.svg
  gantry graph --dot - | dot -Tpdf > graph.pdf";

/// `gantry graph`.
#[derive(clap::Args, Debug, Clone)]
#[command(after_help = GRAPH_NOTES)]
pub struct GraphArgs {
    /// Draw it into this file
    #[arg(long, value_name = "FILE")]
    pub svg: Option<PathBuf>,
    /// Write it in Graphviz's language into this file
    #[arg(long, value_name = "FILE")]
    pub dot: Option<PathBuf>,
    /// Print a JSON object with processes, topics and arrows
    #[arg(long)]
    pub json: bool,
    /// Give every topic a box of its own
    #[arg(long)]
    pub all: bool,
    /// Only topics whose name or type contains this, and the processes at their ends
    #[arg(
        long,
        value_name = "TEXT",
        default_value = "",
        hide_default_value = true
    )]
    pub filter: String,
}
