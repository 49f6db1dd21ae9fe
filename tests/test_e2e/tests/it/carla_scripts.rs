//! Scripts with the stock CARLA client, one row each: the script, the world that it runs in, its
//! arguments and the themes that it must say it has passed. What a script checks stands in its own
//! first lines. Each has a simulator and a gateway of its own, which must end well and leave nothing.

use schema_bus::names;
use test_e2e::carla::{Stage, empty_town, free_port, run_script};
use test_e2e::{document, join_bus};
use test_kit::sandbox::repository;
use test_kit::{Ended, Sandbox};

/// A row of the table.
struct Script {
    /// File in `tests/test_e2e/python`.
    file: &'static str,
    /// The world, without sensors of its own and without cars.
    town: &'static str,
    /// What it is told besides the gateway's port.
    arguments: fn(&Stage) -> Vec<String>,
    /// Themes that it says it has passed.
    themes: &'static [&'static str],
}

/// Runs a script to its end and returns what the gateway said.
fn run(script: &Script) -> Ended {
    let name = script
        .file
        .trim_start_matches("carla_")
        .trim_end_matches(".py");
    let stage = Stage::new(name, &empty_town(script.town));
    let arguments = (script.arguments)(&stage);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    stage.run(script.file, &arguments, script.themes);
    stage.end()
}

fn nothing(_: &Stage) -> Vec<String> {
    Vec::new()
}

fn manager_port(_: &Stage) -> Vec<String> {
    vec![free_port().to_string()]
}

/// `claim: script in town, arguments, themes`, and what the gateway must have said or not, if
/// anything.
macro_rules! scripts {
    ($($(#[$doc:meta])* $claim:ident: $file:literal in $town:literal, $arguments:expr,
        [$($theme:literal),*] $(, gateway says $said:literal)? $(, gateway never says $unsaid:literal)?;)*) => {$(
        $(#[$doc])*
        #[test]
        fn $claim() {
            let _ended = run(&Script {
                file: $file,
                town: $town,
                arguments: $arguments,
                themes: &[$($theme),*],
            });
            $(assert!(_ended.says($said), "{}", _ended.lines.join("\n"));)?
            $(assert!(!_ended.says($unsaid), "{}", _ended.lines.join("\n"));)?
        }
    )*};
}

scripts! {
    /// The blueprint library against CARLA's.
    blueprints_are_carlas_but_for_those_that_the_page_names:
        "carla_blueprints.py" in "Town10HD",
        |_| vec![repository().join("docs/reference/carla-compatibility.md").display().to_string()],
        ["sensors", "vehicles", "walkers", "props", "recommended"];
    /// Attributes of sensors by what they do to messages.
    attributes_of_sensors_act_as_their_names_say:
        "carla_attributes.py" in "Town10HD", nothing,
        ["film", "views", "lidar fans", "lidar losses", "radar", "imu", "gnss", "obstacle", "events"];
    cars_follow_their_lanes_at_the_gains_of_carlas_agents:
        "carla_controller.py" in "Town10HD",
        |_| ["Town10HD", "Town01", "Town04"].map(String::from).to_vec(),
        ["Town10HD", "Town01", "Town04"];
    /// Commands of batches, and rare calls, by what they do.
    every_command_of_a_batch_does_what_newton_says:
        "carla_commands.py" in "Town06", nothing,
        ["places", "pushes", "levers", "wheels", "boxes", "traffic lights", "registry", "ackermann",
         "lamps", "collisions", "files", "ros"];
    /// Every method of the client's main classes, by introspection.
    every_method_answers_in_time_and_without_errors:
        "carla_every_method.py" in "Town10HD", nothing,
        ["World", "Vehicle", "Walker", "TrafficLight", "TrafficSign", "Camera", "Radio", "Lines",
         "Controller", "Spectator", "Client", "gone"];
    lights_switch_by_their_times_and_cars_know_before_which_they_stand:
        "carla_lights.py" in "Town10HD", nothing,
        ["times", "states", "boxes", "cars", "signs", "weather"];
    /// Lens, blur and rarer calls against NumPy.
    a_lens_bends_and_blurs_as_its_attributes_say_and_rare_calls_do_what_they_promise:
        "carla_optics.py" in "Town10HD", nothing,
        ["lens", "motion blur", "focus", "film", "ignored vehicles", "gravity", "bones", "radio",
         "riders"];
    /// Physical data, Ackermann control, pushes, switches, telemetry.
    physical_data_and_pushes_do_what_newton_says:
        "carla_physics.py" in "Town06", nothing,
        ["fields", "mass", "friction", "ackermann", "constant velocity", "pushes", "substeps",
         "long ticks", "sticky", "no physics", "telemetry", "two wheels", "six wheels", "half turn",
         "props", "prop in the way", "walkers"];
    doors_weather_street_lights_physics_and_bones_are_recorded_and_replayed:
        "carla_recorder_changes.py" in "Town02", nothing,
        ["changes", "changes replayed"];
    recordings_in_carlas_own_format_are_told_about_and_replayed:
        "carla_log.py" in "Town10HD", nothing,
        ["texts", "replay", "part", "damaged"];
    replays_hold_vehicles_make_sensors_and_give_everything_back:
        "carla_replay.py" in "Town10HD", nothing,
        ["text", "ignored", "sensors", "kept", "names"];
    /// Environment objects, layers, boxes, street lights.
    scenery_is_listed_hidden_and_lit_for_every_sensor:
        "carla_scenery.py" in "Town02", nothing,
        ["objects", "hiding", "layers", "lights", "collisions", "lamps_of_before"];
    /// What sensors see, when they send, who may listen.
    sensors_arrive_for_their_frame_and_show_what_is_there:
        "carla_sensors.py" in "Town10HD", nothing,
        ["every kind", "pictures", "lidars", "motion", "sensor_tick", "listeners", "lanes", "ahead",
         "boom", "free running"],
        gateway never says "does not take its sensor's messages";
    the_python_package_reads_the_same_frames_without_a_copy:
        "carla_attach.py" in "Town10HD",
        |stage| vec![stage.sandbox.domain().to_owned()],
        ["same frames", "without listening", "choice", "sentences"];
    /// What chance decides is the same in every run of a script.
    noise_follows_from_attributes_and_seed_and_not_from_ids_or_the_simulators_age:
        "carla_noise.py" in "Town02", nothing,
        ["apart", "reload", "neighbours", "again"];
    /// The manager's thread shares a connection with the script and may be anywhere in its work when
    /// the script spawns, destroys or loads a world.
    a_traffic_manager_bears_births_deaths_and_other_worlds:
        "carla_managers.py" in "Town10HD", manager_port,
        ["newborn", "free worlds", "stepped worlds", "all"];
    /// Vehicle-to-everything radio.
    stations_hear_each_other_as_the_formulas_say:
        "carla_v2x.py" in "Town10HD", nothing,
        ["awareness", "range", "custom", "noise", "obstacles", "budget", "roadside", "sentences"],
        gateway says "a custom message has 100 bytes; at most 99 are sent";
    /// The catalogue, friction areas, collision impulses, doors.
    vehicles_are_those_of_the_list_and_obey_newton:
        "carla_vehicles.py" in "Town06", nothing,
        ["catalogue", "every blueprint", "paint", "friction area", "collision impulse", "doors"];
    /// People on foot.
    the_stock_client_walks:
        "carla_walkers.py" in "Town10HD", nothing,
        ["blueprints", "control", "collision", "bones", "wheelchair", "props", "navigation", "crowd"];
    /// The first steps of a session as CARLA's own guides go about them.
    a_session_from_the_first_connection_to_restored_settings:
        "carla_workflow.py" in "Town10HD", manager_port,
        ["connection", "settings", "maps", "layers", "generated world", "blueprints", "ego",
         "sensors", "manual control", "traffic manager", "restoring"];
}

/// A recording of the client is a file that stays.
#[test]
fn drives_are_recorded_told_about_and_replayed() {
    let stage = Stage::new("recorder", &empty_town("Town10HD"));
    let themes = ["recording", "texts", "replay", "anew"];
    stage.run("carla_recorder.py", &[], &themes);
    let recording = stage.sandbox.path("data/recordings/carla/drive.log");
    assert!(recording.exists(), "recordings stay in the data folder");
    stage.end();
}

/// The client's own Traffic Manager: it obeys lights, paths, speeds, drives near cars and moves far
/// ones, and fifty cars touch nothing. With `GANTRY_SOAK=1` fifty cars drive ten minutes stepped and
/// ten minutes free.
#[test]
fn fifty_cars_drive_without_touching_anything() {
    let stage = Stage::new("carlatraffic", &empty_town("Town10HD"));
    let manager_port = free_port().to_string();
    stage.run(
        "carla_traffic.py",
        &[&manager_port],
        &["lights", "paths", "speeds", "hybrid", "fifty"],
    );
    if std::env::var_os("GANTRY_SOAK").is_some() {
        for mode in ["sync", "async"] {
            let (port, manager_port) = (stage.port.to_string(), free_port().to_string());
            let args = [&port, &manager_port, mode, "600"];
            let drive = run_script(&stage.sandbox, "carla_traffic.py", &args, &[mode]);
            println!("{}", drive.lines.join("\n"));
        }
    }
    stage.end();
}

/// Maps of the map folder and maps from a text.
#[test]
fn the_stock_client_lists_loads_and_generates_maps() {
    let sandbox = Sandbox::new("carlamaps");
    let data = sandbox.path("data");
    std::fs::create_dir_all(data.join("maps")).unwrap();
    let stage = Stage::with(
        sandbox,
        &empty_town("Town02"),
        &["--data", data.to_str().unwrap()],
    );
    // The text of a generated town is loaded like any user's file.
    let bus = join_bus(&stage.sandbox, "test");
    let file = data.join("maps/mine.xodr");
    std::fs::write(&file, document(&bus, names::WORLD_MAP).text).unwrap();
    drop(bus);
    // A file outside the map folder, which no client may reach.
    std::fs::copy(&file, stage.sandbox.path("secret.xodr")).unwrap();
    stage.run(
        "carla_maps.py",
        &[file.to_str().unwrap()],
        &["listing", "folder", "generating", "refusals", "many"],
    );
    stage.end();
}
