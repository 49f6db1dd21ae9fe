//! Names of the services that every domain has, without the domain.

use schema_frames::Modality;
use schema_frames::about::ABOUT;
use schema_frames::document::BATCH_RIG;

/// Topic of the snapshot after every tick.
pub const WORLD_SNAPSHOT: &str = "world/snapshot";
/// Topic and event: every frame of a tick was sent. Only while ticks wait for somebody.
pub const WORLD_COMPLETE: &str = "world/complete";
/// Document: who publishes, and what a reader must know first.
pub const WORLD_INFO: &str = "world/info";
/// Document: OpenDRIVE text of the map.
pub const WORLD_MAP: &str = "world/map";
/// Document: all actors.
pub const WORLD_ACTORS: &str = "world/actors";
/// Document: types of actors that can be spawned.
pub const WORLD_CATALOGUE: &str = "world/catalogue";
/// Document: poses at which vehicles may be spawned on the map.
pub const WORLD_SPAWN_POINTS: &str = "world/spawn_points";
/// Topic of the spectator's image, which is rendered only while somebody reads it.
pub const SPECTATOR_RGB: &str = "spectator/rgb";
/// Commands: requests and their answers.
pub const CONTROL_WORLD: &str = "control/world";
/// Topic of vehicle controls.
pub const CONTROL_VEHICLES: &str = "control/vehicles";
/// Topic of lockstep acknowledgements.
pub const CONTROL_ACK: &str = "control/ack";
/// Event to the daemon: a request, control, acknowledgement or new reader waits for it.
pub const CONTROL_WAKE: &str = "control/wake";
/// Event from the daemon: replies were sent.
pub const CONTROL_REPLIED: &str = "control/replied";
/// Event that only the publisher of the domain's world has open: see [`crate::Bus::claim_world`].
pub const CONTROL_OWNER: &str = "control/owner";
/// Topic of what render workers see of a tick.
pub const CONTROL_SCENE: &str = "control/scene";
/// Topic of the answers of render workers.
pub const CONTROL_RENDERED: &str = "control/rendered";
/// Questions of render workers: their places, cameras and scenery.
pub const CONTROL_RENDER: &str = "control/render";

/// Domain of a program that is told no other.
pub const DEFAULT_DOMAIN: &str = "gantry";
/// The one environment variable that is an interface: the domain of a program that is told no
/// other. `gantry up` sets it for the processes that it starts.
pub const DOMAIN_VARIABLE: &str = "GANTRY_DOMAIN";

/// Domain of a program that is told no other: [`DOMAIN_VARIABLE`] if it is set and not empty, else
/// [`DEFAULT_DOMAIN`]. Whether it can be a domain is checked where it is opened.
pub fn default_domain() -> String {
    std::env::var_os(DOMAIN_VARIABLE)
        .map(|domain| domain.to_string_lossy().into_owned())
        .filter(|domain| !domain.is_empty())
        .unwrap_or_else(|| DEFAULT_DOMAIN.to_owned())
}

/// Name of the event after a rig's last frame of a tick.
pub fn rig_tick(rig: &str) -> String {
    format!("{rig}/tick")
}

/// Rig of a frame topic: `ego` of `ego/front/rgb`.
pub fn rig_of(topic: &str) -> &str {
    topic.split('/').next().unwrap_or(topic)
}

/// Whether a topic has the images of several cameras in each frame: `batch/fleet/rgb`.
pub fn is_batch(topic: &str) -> bool {
    rig_of(topic) == BATCH_RIG && modality_of(topic).is_some()
}

/// Name of the document that describes the result topic `topic`.
pub fn about(topic: &str) -> String {
    format!("{topic}/{ABOUT}")
}

/// Last segment of the service on which a topic's samples on a GPU are sent.
const GPU: &str = "gpu";

/// Name of the service of a topic's samples on a GPU: `ego/front/rgb/gpu` of `ego/front/rgb`.
pub fn gpu_topic(topic: &str) -> String {
    format!("{}/{GPU}", host_topic(topic))
}

/// The topic whose samples on a GPU are sent on this service; any other name as it is.
pub fn host_topic(topic: &str) -> &str {
    let host = topic.strip_suffix(GPU);
    host.and_then(|rest| rest.strip_suffix('/'))
        .unwrap_or(topic)
}

/// Whether this is the service of a topic's samples on a GPU.
pub fn is_gpu_topic(topic: &str) -> bool {
    host_topic(topic).len() < topic.len()
}

/// Modality of a frame topic, or of its service on a GPU.
pub fn modality_of(topic: &str) -> Option<Modality> {
    Modality::from_name(host_topic(topic).rsplit('/').next()?)
}

/// Whether users' programs may not publish on `topic`: `world/`, `control/` and the spectator are
/// the simulator's, a last segment `about` is a description's, and a last segment `gpu` is the GPU's.
pub fn is_reserved(topic: &str) -> bool {
    ["world", "control"].contains(&rig_of(topic))
        || topic == SPECTATOR_RGB
        || topic.rsplit('/').next() == Some(ABOUT)
        || is_gpu_topic(topic)
}

/// `name` cut to 40 bytes and padded with zeros.
pub(crate) fn name_bytes(name: &str) -> [u8; 40] {
    let mut bytes = [0; 40];
    let mut len = name.len().min(40);
    while !name.is_char_boundary(len) {
        len -= 1;
    }
    bytes[..len].copy_from_slice(&name.as_bytes()[..len]);
    bytes
}

/// The text before the padding; bytes that are not UTF-8 become �.
pub(crate) fn name_text(bytes: &[u8; 40]) -> String {
    let len = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..len]).into_owned()
}

/// Whether `topic` is a valid name without a domain.
pub(crate) fn valid_topic(topic: &str) -> bool {
    topic.len() <= 200
        && topic.split('/').all(|segment| {
            !segment.is_empty()
                && segment
                    .bytes()
                    .all(|b| b.is_ascii_alphanumeric() || b"_-.".contains(&b))
        })
}

/// Whether `domain` is a valid first segment.
pub(crate) fn valid_domain(domain: &str) -> bool {
    (1..=32).contains(&domain.len())
        && domain
            .bytes()
            .all(|b| b.is_ascii_alphanumeric() || b"_-".contains(&b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gpus_service_of_a_topic_is_told_from_a_sensor_called_gpu() {
        assert_eq!(host_topic("detector/features/gpu"), "detector/features");
        assert_eq!(gpu_topic("ego/front/rgb"), "ego/front/rgb/gpu");
        assert_eq!(gpu_topic("ego/front/rgb/gpu"), "ego/front/rgb/gpu");
        assert_eq!(host_topic("ego/front/rgb/gpu"), "ego/front/rgb");
        assert_eq!(modality_of("ego/front/rgb/gpu"), Some(Modality::Rgb));
        assert!(is_gpu_topic("ego/front/rgb/gpu"));
        assert!(!is_gpu_topic("ego/gpu/rgb") && is_reserved("detector/gpu"));
        assert!(!is_gpu_topic("gpu") && !is_gpu_topic("ego/front/rgb"));
        assert!(!is_gpu_topic("ego/mygpu"));
    }

    #[test]
    fn a_batch_is_told_by_its_first_segment() {
        assert!(is_batch("batch/fleet/rgb") && is_batch("batch/fleet/rgb/gpu"));
        assert!(!is_batch("ego/batch/rgb") && !is_batch("batch/tick") && !is_batch("batch"));
    }

    #[test]
    fn names_with_empty_segments_or_odd_characters_are_refused() {
        assert!(valid_topic("ego/front/rgb") && valid_topic("a"));
        for bad in [
            "",
            "/ego",
            "ego/",
            "ego//rgb",
            "ego front",
            "ego/\u{e9}",
            &"a".repeat(201),
        ] {
            assert!(!valid_topic(bad), "{bad:?}");
        }
        assert!(
            valid_domain("gantry")
                && !valid_domain("")
                && !valid_domain("a/b")
                && !valid_domain(&"x".repeat(33))
        );
    }
}
