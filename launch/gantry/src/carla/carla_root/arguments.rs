//! The arguments of CARLA's server, which are those of its engine too.

use launch_cli::wrong_usage;

/// Port of a server that is given none.
const DEFAULT_PORT: u16 = 2000;
/// Ticks per second of the engine's benchmark mode when it is given none.
const BENCHMARK_HZ: f64 = 30.0;

/// Switches about windows, sound, drivers and logs, which say nothing about a server without any.
const WITHOUT_MEANING: [&str; 33] = [
    "abslog",
    "allowroot",
    "carla-no-hud",
    "carla-server",
    "deterministic",
    "forceres",
    "fullscreen",
    "game",
    "gl",
    "log",
    "nohmd",
    "noloadingscreen",
    "nopause",
    "noscreenmessages",
    "nosound",
    "nosplash",
    "notexturestreaming",
    "nothreading",
    "novsync",
    "opengl",
    "opengl4",
    "prefernvidia",
    "renderoffscreen",
    "resx",
    "resy",
    "rpcthreads",
    "stdout",
    "streamingthreads",
    "unattended",
    "vulkan",
    "windowed",
    "winx",
    "winy",
];

/// What a command line of CARLA's server asks for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wishes {
    /// Port of the RPC server.
    pub port: u16,
    /// Port of the streams; 0 is any free one.
    pub stream_port: u16,
    /// Map to begin with.
    pub map: Option<String>,
    /// Fixed step as ticks per second.
    pub tick_hz: Option<f64>,
    /// As fast as possible.
    pub unpaced: bool,
    /// No pictures until a client wants them.
    pub no_rendering: bool,
    /// `low` or `high`.
    pub quality: Option<&'static str>,
    /// Index of the GPU.
    pub adapter: Option<usize>,
    /// One sentence per argument that has no effect though it would have one in CARLA.
    pub warnings: Vec<String>,
}

/// Reads the arguments behind the program's name. As the engine does, names are compared without
/// case.
///
/// # Errors
/// A sentence if a value of an argument that counts cannot be.
pub fn read(args: &[String]) -> anyhow::Result<Wishes> {
    let mut wishes = Wishes {
        port: DEFAULT_PORT,
        ..Wishes::default()
    };
    let mut stream_port = None;
    let mut benchmark = false;
    for arg in args {
        let Some(switch) = arg.strip_prefix('-') else {
            wishes.take_map(arg);
            continue;
        };
        let (name, value) = switch.split_once('=').unwrap_or((switch, ""));
        let value = value.trim_matches('"');
        let name = name.trim_start_matches('-').to_ascii_lowercase();
        match name.as_str() {
            "carla-rpc-port" | "carla-port" | "carla-world-port" | "world-port" => {
                wishes.port = number(arg, value, "a port from 1 to 65534", |port| {
                    (1..=65534).contains(port)
                })?;
            }
            "carla-streaming-port" => {
                stream_port = Some(number(arg, value, "a port, or 0 for any free one", |_| {
                    true
                })?);
            }
            "fps" => {
                let wanted = "a number of ticks per second above 0";
                wishes.tick_hz = Some(number(arg, value, wanted, |hz: &f64| {
                    hz.is_finite() && *hz > 0.0
                })?);
            }
            "benchmark" => benchmark = true,
            "no-rendering" | "nullrhi" => wishes.no_rendering = true,
            "quality-level" => match value.to_ascii_lowercase().as_str() {
                "low" => wishes.quality = Some("low"),
                "epic" => wishes.quality = Some("high"),
                _ => wishes.warn(format!("{arg}: quality levels are Low and Epic; ignored")),
            },
            "graphicsadapter" => {
                let wanted = "the index of a GPU, 0 for the first";
                wishes.adapter = Some(number(arg, value, wanted, |_| true)?);
            }
            "ros2" => wishes.warn(format!("{arg}: there is no ROS 2 interface; ignored")),
            _ if WITHOUT_MEANING.binary_search(&name.as_str()).is_ok() => {}
            _ => wishes.warn(format!("{arg} has no effect here; ignored")),
        }
    }
    if benchmark {
        wishes.unpaced = true;
        wishes.tick_hz = wishes.tick_hz.or(Some(BENCHMARK_HZ));
    }
    wishes.stream_port = stream_port.unwrap_or(wishes.port + 1);
    anyhow::ensure!(
        wishes.stream_port != wishes.port,
        wrong_usage(format!(
            "-carla-streaming-port and -carla-rpc-port are both {}; give two ports",
            wishes.port
        ))
    );
    Ok(wishes)
}

impl Wishes {
    fn warn(&mut self, sentence: String) {
        self.warnings.push(sentence);
    }

    /// A word without a dash is the project's name, which is the first, or the map: its name or the
    /// path of its asset.
    fn take_map(&mut self, word: &str) {
        let map = word.split('?').next().unwrap_or_default();
        let map = map.rsplit('/').next().unwrap_or_default();
        if map.is_empty() || map.eq_ignore_ascii_case("CarlaUE4") || map.ends_with(".uproject") {
            return;
        }
        let map = map.split('.').next().unwrap_or_default();
        self.map = Some(map.strip_suffix("_Opt").unwrap_or(map).to_owned());
    }
}

/// The number that an argument has as its value, if it `can_be`.
fn number<T: std::str::FromStr>(
    arg: &str,
    value: &str,
    wanted: &str,
    can_be: impl Fn(&T) -> bool,
) -> anyhow::Result<T> {
    let read = value.parse().ok().filter(can_be);
    read.ok_or_else(|| wrong_usage(format!("{arg} cannot be: give {wanted}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(line: &str) -> Wishes {
        let words: Vec<String> = line.split_whitespace().map(str::to_owned).collect();
        read(&words).unwrap()
    }

    #[test]
    fn ignored_switches_are_in_order_for_the_search() {
        assert!(WITHOUT_MEANING.is_sorted());
    }

    #[test]
    fn what_evaluators_ask_for_is_understood_without_a_warning() {
        let wishes =
            of("CarlaUE4 -RenderOffScreen -nosound -carla-rpc-port=2400 -graphicsadapter=3");
        assert_eq!(
            wishes,
            Wishes {
                port: 2400,
                stream_port: 2401,
                adapter: Some(3),
                ..Wishes::default()
            }
        );
        let wishes = of(
            "CarlaUE4 -quality-level=Epic -world-port=2000 -resx=800 -resy=600 -nosound -carla-streaming-port=0 -RenderOffScreen",
        );
        assert_eq!((wishes.port, wishes.stream_port), (2000, 0));
        assert_eq!((wishes.quality, wishes.warnings), (Some("high"), vec![]));
        let wishes =
            of("/Game/Carla/Maps/Town03_Opt -windowed -ResX=10 -benchmark -FPS=10 -carla-server");
        assert_eq!(wishes.map.as_deref(), Some("Town03"));
        assert_eq!((wishes.tick_hz, wishes.unpaced), (Some(10.0), true));
        assert!(wishes.warnings.is_empty(), "{:?}", wishes.warnings);
        assert_eq!(of("-benchmark").tick_hz, Some(30.0));
    }

    #[test]
    fn unknown_arguments_are_named() {
        let wishes = of("CarlaUE4 -carla-settings=a.ini -ros2 -quality-level=Medium");
        assert_eq!(wishes.warnings.len(), 3, "{:?}", wishes.warnings);
        assert!(wishes.warnings[0].starts_with("-carla-settings=a.ini"));
    }

    #[test]
    fn values_that_cannot_be_are_refused_in_a_sentence() {
        for line in [
            "-carla-rpc-port=70000",
            "-carla-rpc-port=",
            "-carla-rpc-port=65535",
            "-carla-streaming-port=x",
            "-fps=0",
            "-fps=nan",
            "-graphicsadapter=-1",
            "-carla-rpc-port=2000 -carla-streaming-port=2000",
        ] {
            let words: Vec<String> = line.split_whitespace().map(str::to_owned).collect();
            let error = read(&words).unwrap_err();
            assert!(error.is::<launch_cli::WrongUsage>(), "{line}: {error}");
            assert!(error.to_string().contains("give "), "{line}: {error}");
        }
    }
}
