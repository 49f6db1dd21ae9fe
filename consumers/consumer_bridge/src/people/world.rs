//! The world's settings as parameters, and its clock as services: pause, resume, step.

use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use consumer_kit::FollowedDocument;
use crossbeam_channel::{Sender, bounded};
use foxglove::WebSocketServerHandle;
use foxglove::websocket::service::{Service, ServiceSchema};
use foxglove::websocket::{
    AnyClient, GetParametersResponder, Parameter, ParameterHandler, ParameterValue,
    SetParametersResponder,
};
use launch_cli::accept::Seldom;
use launch_cli::logging::cut;
use parking_lot::Mutex;
use schema_bus::{Bus, BusOptions, CommandClient, names};
use schema_frames::{Command, CommandBatch, CommandReply, StepMode, WorldInfo};

use crate::options::Options;

/// How long the simulator may take for one command.
const TIMEOUT: Duration = Duration::from_secs(10);
/// Clients' settings that wait at a time.
const MAX_SETTINGS: usize = 64;
/// Name under which commands are sent.
const NAME: &str = "foxglove";

/// The world behind the server.
pub struct World {
    domain: String,
    bus: BusOptions,
    control: bool,
    commands: Mutex<Option<(CommandClient, Bus)>>,
    info: Mutex<Option<WorldInfo>>,
    document: Mutex<FollowedDocument>,
    speed: Mutex<f64>,
    warnings: Seldom,
}

impl World {
    /// A world that is not known yet.
    pub fn new(options: &Options) -> World {
        World {
            domain: options.domain.clone(),
            bus: options.bus.clone(),
            control: options.control,
            commands: Mutex::default(),
            info: Mutex::default(),
            document: Mutex::new(FollowedDocument::optional(names::WORLD_INFO)),
            speed: Mutex::new(1.0),
            warnings: Seldom::default(),
        }
    }

    /// Closes its ports, because the server may keep this for longer than there is a bus. A command
    /// that waits for its answer keeps its own.
    pub fn leave(&self) {
        *self.document.lock() = FollowedDocument::optional(names::WORLD_INFO);
        if let Some(mut commands) = self.commands.try_lock() {
            *commands = None;
        }
    }

    /// Looks whether anything changed, and tells clients that subscribe to it.
    ///
    /// # Errors
    /// None that waiting heals.
    pub fn look(&self, bus: &Bus, server: Option<&WebSocketServerHandle>) -> anyhow::Result<()> {
        let mut document = self.document.lock();
        let Some(changed) = document.changed(bus)? else {
            return Ok(());
        };
        *self.info.lock() = changed.json().ok();
        if let Some(server) = server {
            server.publish_parameter_values(self.parameters(&[]));
        }
        Ok(())
    }

    /// The parameters of these names; all without a name.
    fn parameters(&self, wanted: &[String]) -> Vec<Parameter> {
        let info = self.info.lock();
        let Some(info) = info.as_ref() else {
            return Vec::new();
        };
        let number = ParameterValue::Float64;
        let text = |text: &str| ParameterValue::String(text.to_owned());
        let all = [
            ("map", text(&info.map)),
            ("source", text(&info.source)),
            (
                "paused",
                ParameterValue::Bool(info.mode == StepMode::Stepped),
            ),
            ("speed", number(*self.speed.lock())),
            ("period_ms", number(info.period_nanos as f64 * 1e-6)),
            ("seed", text(&info.seed.to_string())),
            ("weather.cloudiness", number(info.weather.cloudiness.into())),
            (
                "weather.precipitation",
                number(info.weather.precipitation.into()),
            ),
            (
                "weather.fog_density",
                number(info.weather.fog_density.into()),
            ),
            (
                "weather.sun_altitude_deg",
                number(info.weather.sun_altitude_deg.into()),
            ),
            (
                "weather.sun_azimuth_deg",
                number(info.weather.sun_azimuth_deg.into()),
            ),
        ];
        all.into_iter()
            .filter(|(name, _)| wanted.is_empty() || wanted.iter().any(|of| of == name))
            .map(|(name, value)| Parameter {
                name: name.to_owned(),
                r#type: None,
                value: Some(value),
            })
            .collect()
    }

    /// The commands that set a parameter; an error says what may be set.
    fn setting(&self, parameter: &Parameter) -> anyhow::Result<Command> {
        let number = match parameter.value {
            Some(ParameterValue::Float64(number)) => Some(number),
            Some(ParameterValue::Integer(number)) => Some(number as f64),
            _ => None,
        };
        let mut weather = self.info.lock().as_ref().map(|info| info.weather);
        let mut change = |at: fn(&mut schema_frames::document::Weather) -> &mut f32| {
            let weather = weather.as_mut().context("there is no world yet")?;
            *at(weather) = number.context("it takes a number")? as f32;
            anyhow::Ok(Command::SetWeather { weather: *weather })
        };
        match parameter.name.as_str() {
            "paused" => match parameter.value {
                Some(ParameterValue::Bool(is_paused)) => Ok(mode(is_paused)),
                _ => anyhow::bail!("paused takes true or false"),
            },
            "speed" => Ok(Command::SetSpeed {
                ratio: number.context("speed takes a number")?,
            }),
            "weather.cloudiness" => change(|weather| &mut weather.cloudiness),
            "weather.precipitation" => change(|weather| &mut weather.precipitation),
            "weather.fog_density" => change(|weather| &mut weather.fog_density),
            "weather.sun_altitude_deg" => change(|weather| &mut weather.sun_altitude_deg),
            "weather.sun_azimuth_deg" => change(|weather| &mut weather.sun_azimuth_deg),
            other => anyhow::bail!("{other:?} cannot be set; paused, speed and weather.… can"),
        }
    }

    /// Sends one command to the simulator.
    fn command(&self, command: Command) -> anyhow::Result<CommandReply> {
        anyhow::ensure!(
            self.control,
            "the bridge was started with --no-control; start it without"
        );
        let mut commands = self.commands.lock();
        let (client, _) = match &mut *commands {
            Some(open) => open,
            empty => {
                let bus = Bus::open_with(&self.domain, "gantry-bridge", &self.bus)?;
                empty.insert((bus.command_client(NAME)?, bus))
            }
        };
        let answer = client.request(&CommandBatch::new(vec![command]), TIMEOUT)?;
        match answer.replies.into_iter().next() {
            Some(CommandReply::Refused { error }) => anyhow::bail!("{error}"),
            Some(reply) => Ok(reply),
            None => anyhow::bail!("the simulator's answer is empty"),
        }
    }
}

fn mode(is_paused: bool) -> Command {
    Command::Configure {
        mode: Some(match is_paused {
            true => StepMode::Stepped,
            false => StepMode::FreeRunning,
        }),
        period_nanos: None,
        longest_substep_nanos: None,
    }
}

/// Answers clients who ask for parameters or set them. The server's threads must not wait, and the
/// simulator takes its time, so what is set goes through a thread of its own.
pub struct Parameters {
    world: Arc<World>,
    settings: Sender<Setting>,
}

/// What a client sets, and who answers it.
type Setting = (Vec<Parameter>, SetParametersResponder);

impl Parameters {
    /// Starts the thread, which ends with this.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn start(world: &Arc<World>) -> anyhow::Result<Parameters> {
        let (settings, asked) = bounded::<Setting>(MAX_SETTINGS);
        let of = world.clone();
        std::thread::Builder::new()
            .name("settings".into())
            .spawn(move || {
                for (parameters, responder) in asked {
                    responder.respond(of.set(parameters));
                }
            })
            .context("the system gives no thread")?;
        Ok(Parameters {
            world: world.clone(),
            settings,
        })
    }
}

impl ParameterHandler for Parameters {
    fn get(
        &self,
        _client: AnyClient,
        names: Vec<String>,
        _request_id: Option<String>,
        responder: GetParametersResponder,
    ) {
        responder.respond(self.world.parameters(&names));
    }

    fn set(
        &self,
        _client: AnyClient,
        parameters: Vec<Parameter>,
        _request_id: Option<String>,
        responder: SetParametersResponder,
    ) {
        if let Err(full) = self.settings.try_send((parameters, responder)) {
            // The client gets the values that hold.
            let (parameters, responder) = full.into_inner();
            let names: Vec<String> = parameters.into_iter().map(|it| it.name).collect();
            responder.respond(self.world.parameters(&names));
        }
    }
}

impl World {
    /// Sets parameters; returns what holds then.
    fn set(&self, parameters: Vec<Parameter>) -> Vec<Parameter> {
        let mut applied = Vec::new();
        for parameter in parameters {
            let done = self.setting(&parameter).and_then(|command| {
                if let Command::SetSpeed { ratio } = command {
                    self.command(Command::SetSpeed { ratio })?;
                    *self.speed.lock() = ratio;
                    return Ok(());
                }
                self.command(command).map(drop)
            });
            match done {
                Ok(()) => applied.push(parameter),
                Err(error) => {
                    if let Some(n_unsaid) = self.warnings.is_due() {
                        let (name, error) = (cut(&parameter.name), format!("{error:#}"));
                        tracing::warn!(
                            parameter = %name,
                            n_unsaid,
                            "a Foxglove client cannot set it: {}",
                            cut(&error)
                        );
                    }
                    // It gets the value that holds.
                    applied.extend(self.parameters(std::slice::from_ref(&parameter.name)));
                }
            }
        }
        applied
    }
}

/// `/pause`, `/resume`, and `/step`, which takes `{"n": 1}`.
///
/// # Errors
/// None; the signature leaves room for those of the schemas.
pub fn services(world: &Arc<World>) -> anyhow::Result<Vec<Service>> {
    let service = |name: &str, run: fn(&World, &[u8]) -> anyhow::Result<String>| {
        let world = world.clone();
        let schema = ServiceSchema::new(name);
        Service::builder(format!("/{name}"), schema).blocking_handler_fn(move |request| {
            run(&world, request.payload()).map_err(|error| format!("{error:#}"))
        })
    };
    Ok(vec![
        service("pause", |world, _| {
            world.command(mode(true))?;
            Ok("{}".to_owned())
        }),
        service("resume", |world, _| {
            world.command(mode(false))?;
            Ok("{}".to_owned())
        }),
        service("step", |world, request| {
            let n = step_of(request)?;
            match world.command(Command::Step { n })? {
                CommandReply::Stepping { last_tick } => {
                    Ok(format!("{{\"last_tick\":{last_tick}}}"))
                }
                other => anyhow::bail!("the simulator answered {other:?}"),
            }
        }),
    ])
}

/// Number of ticks that a request of `/step` asks for; 1 if it does not say.
fn step_of(request: &[u8]) -> anyhow::Result<u64> {
    if request.iter().all(u8::is_ascii_whitespace) {
        return Ok(1);
    }
    let request: serde_json::Value =
        serde_json::from_slice(request).context("the request is no JSON; write {\"n\": 1}")?;
    match request.get("n") {
        None => Ok(1),
        Some(n) => n
            .as_u64()
            .filter(|n| *n > 0)
            .with_context(|| format!("n is {n}, but must be 1 or more")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_one_tick_unless_the_request_says_more() {
        for (request, n) in [("", 1), (" ", 1), ("{}", 1), ("{\"n\": 7}", 7)] {
            assert_eq!(step_of(request.as_bytes()).unwrap(), n);
        }
        for wrong in ["{\"n\": 0}", "{\"n\": -1}", "{\"n\": \"a\"}", "seven"] {
            assert!(step_of(wrong.as_bytes()).is_err(), "{wrong}");
        }
    }
}
