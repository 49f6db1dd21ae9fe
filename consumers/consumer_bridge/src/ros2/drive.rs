//! Vehicles driven by nodes of ROS 2: `ackermann_cmd` and `vehicle_control_cmd` of each rig.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::Context as _;
use consumer_forms::ros2::cdr::{ReadError, Reader};
use consumer_forms::ros2::{read, types};
use crossbeam_channel::{Receiver, Sender, bounded};
use parking_lot::Mutex;
use schema_bus::{Bus, CommandClient, ControlWriter, Notifier, names};
use schema_frames::{
    AckermannControl, Command, CommandBatch, CommandReply, PhysicsAction, VehicleControl,
    VehicleControlRecord,
};
use zenoh::sample::Sample;

use crate::options::Options;
use crate::ros2::graph::{Node, Subscription};

/// How long the simulator may take for one command.
const TIMEOUT: Duration = Duration::from_secs(10);
/// Name under which vehicles are controlled.
const NAME: &str = "ros2";
/// Wake-ups that wait for the thread; one is as good as many.
const WAKE_UPS: usize = 1;

/// What a node asks of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Wish {
    /// Steering angle and speed.
    Ackermann(AckermannControl),
    /// Pedals and steering wheel.
    Pedals(VehicleControl),
}

/// The newest wish for each vehicle.
type Wishes = Arc<Mutex<Vec<(u32, Wish)>>>;

/// The thread that passes wishes on.
#[derive(Debug)]
pub struct Driver {
    wishes: Wishes,
    wake: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
    is_on: bool,
}

/// A vehicle's subscriptions.
#[derive(Debug)]
pub struct Vehicle {
    _subscriptions: Vec<Subscription>,
}

impl Driver {
    /// Starts the thread; without controls (`--no-control`) nothing is subscribed to.
    ///
    /// # Errors
    /// [`schema_bus::BusError`].
    pub fn start(options: &Options) -> anyhow::Result<Driver> {
        let wishes = Wishes::default();
        let mut driver = Driver {
            wishes: wishes.clone(),
            wake: None,
            thread: None,
            is_on: options.control,
        };
        if options.control {
            let bus = Bus::open_with(&options.domain, "gantry-bridge", &options.bus)?;
            let mut hands = Hands {
                pedals: bus.control_writer(NAME)?,
                wake: bus.notifier(names::CONTROL_WAKE)?,
                commands: None,
                bus,
            };
            let (wake, woken) = bounded(WAKE_UPS);
            let thread = std::thread::Builder::new()
                .name("drive".into())
                .spawn(move || hands.carry_out(&wishes, &woken))
                .context("the system gives no thread")?;
            (driver.wake, driver.thread) = (Some(wake), Some(thread));
        }
        Ok(driver)
    }

    /// Subscribes to the commands for the rig `name`, whose vehicle is `actor`.
    ///
    /// # Errors
    /// What zenoh says.
    pub fn listen(&self, node: &Node, name: &str, actor: u32) -> anyhow::Result<Vehicle> {
        let mut subscriptions = Vec::new();
        let Some(wake) = self.wake.as_ref().filter(|_| self.is_on) else {
            return Ok(Vehicle {
                _subscriptions: subscriptions,
            });
        };
        type Read = fn(&[u8]) -> Option<Wish>;
        let inputs: [(&str, &types::Type, Read); 3] = [
            ("ackermann_cmd", &types::ACKERMANN, ackermann),
            (
                "ackermann_cmd",
                &types::ACKERMANN_STAMPED,
                ackermann_stamped,
            ),
            ("vehicle_control_cmd", &types::VEHICLE_CONTROL, pedals),
        ];
        for (last, of, read) in inputs {
            let topic = format!("/carla/{name}/{last}");
            let (wishes, wake, said) = (self.wishes.clone(), wake.clone(), topic.clone());
            let take = move |sample: Sample| match read(&sample.payload().to_bytes()) {
                Some(wish) => {
                    let mut wishes = wishes.lock();
                    wishes.retain(|(of, _)| *of != actor);
                    wishes.push((actor, wish));
                    let _ = wake.try_send(());
                }
                None => tracing::debug!(topic = said, "a command that cannot be read"),
            };
            subscriptions.push(node.subscribe(&topic, of, take)?);
        }
        Ok(Vehicle {
            _subscriptions: subscriptions,
        })
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        // The other ends went with the subscriptions.
        self.wake = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// What carries out wishes.
struct Hands {
    // Ports go before their node.
    pedals: ControlWriter,
    commands: Option<CommandClient>,
    wake: Notifier,
    bus: Bus,
}

impl Hands {
    fn carry_out(&mut self, wishes: &Wishes, woken: &Receiver<()>) {
        let mut said = false;
        for () in woken {
            for (actor, wish) in std::mem::take(&mut *wishes.lock()) {
                if let Err(error) = self.do_one(actor, wish)
                    && !std::mem::replace(&mut said, true)
                {
                    tracing::warn!(
                        "a command of ROS 2 is not carried out: {error:#}; further ones are not said"
                    );
                }
            }
        }
    }

    fn do_one(&mut self, actor: u32, wish: Wish) -> anyhow::Result<()> {
        match wish {
            Wish::Pedals(control) => {
                self.pedals
                    .send(0, &[VehicleControlRecord::new(actor, control)])?;
                self.wake.notify_listeners();
            }
            Wish::Ackermann(control) => {
                let commands = match &mut self.commands {
                    Some(commands) => commands,
                    empty => empty.insert(self.bus.command_client(NAME)?),
                };
                let action = PhysicsAction::ControlAckermann { control };
                let command = Command::Physics {
                    actor_id: actor,
                    action,
                };
                let answer = commands.request(&CommandBatch::new(vec![command]), TIMEOUT)?;
                if let Some(CommandReply::Refused { error }) = answer.replies.first() {
                    anyhow::bail!("{error}");
                }
            }
        }
        Ok(())
    }
}

fn ackermann(message: &[u8]) -> Option<Wish> {
    drive(&mut Reader::new(message).ok()?)
}

fn ackermann_stamped(message: &[u8]) -> Option<Wish> {
    let mut reader = Reader::new(message).ok()?;
    read::header(&mut reader).ok()?;
    drive(&mut reader)
}

fn drive(reader: &mut Reader<'_>) -> Option<Wish> {
    let mut next = || reader.f32().ok().filter(|value| value.is_finite());
    Some(Wish::Ackermann(AckermannControl {
        steer_rad: next()?,
        steer_rate_radps: next()?,
        speed_mps: next()?,
        acceleration_mps2: next()?,
        jerk_mps3: next()?,
    }))
}

fn pedals(message: &[u8]) -> Option<Wish> {
    let mut reader = Reader::new(message).ok()?;
    vehicle_control(&mut reader).ok().map(Wish::Pedals)
}

/// CARLA steers positive to the right.
fn vehicle_control(reader: &mut Reader<'_>) -> Result<VehicleControl, ReadError> {
    read::header(reader)?;
    let [throttle, steer, brake] = [reader.f32()?, reader.f32()?, reader.f32()?];
    let (hand_brake, reverse) = (reader.bool()?, reader.bool()?);
    let gear = reader.i32()?.clamp(-1, i8::MAX.into()) as i8;
    let control = VehicleControl {
        throttle_ratio: throttle,
        steer_ratio: -steer,
        brake_ratio: brake,
        hand_brake,
        reverse,
        manual_gear_shift: reader.bool()?,
        gear,
    };
    Ok(control.clamped())
}

#[cfg(test)]
mod tests {
    use super::*;
    use consumer_forms::ros2::cdr::Writer;

    #[test]
    fn commands_are_read_with_their_signs() {
        let mut writer = Writer::default();
        writer.start();
        for value in [0.1f32, 0.0, 5.0, 2.0, 0.0] {
            writer.f32(value);
        }
        let Some(Wish::Ackermann(control)) = ackermann(writer.bytes()) else {
            panic!("no wish")
        };
        assert_eq!((control.steer_rad, control.speed_mps), (0.1, 5.0));
        writer.start().i32(1).u32(2).text("ego");
        writer.f32(0.5).f32(0.25).f32(7.0);
        writer.bool(false).bool(true).i32(3).bool(true);
        let Some(Wish::Pedals(control)) = pedals(writer.bytes()) else {
            panic!("no wish")
        };
        assert_eq!((control.throttle_ratio, control.steer_ratio), (0.5, -0.25));
        assert_eq!((control.brake_ratio, control.gear), (1.0, 3));
        assert!(control.reverse && control.manual_gear_shift && !control.hand_brake);
        assert_eq!(ackermann(&[0, 1, 0, 0, 1]), None);
        let nan = [&[0, 1, 0, 0][..], &f32::NAN.to_le_bytes(), &[0; 16]].concat();
        assert_eq!(ackermann(&nan), None);
    }
}
