//! Quality of service of every kind of topic: constants per schema version. A launch file can give
//! single topics other numbers of readers and samples (`[topic."NAME"]`), never another kind.
//!
//! Readers keep a service alive while a daemon restarts, and a daemon that came back with larger
//! numbers could not join it; within a run they are therefore the same at every start.

/// Capacity of one kind of publish-subscribe topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Qos {
    /// Number of readers at a time.
    pub readers: usize,
    /// Number of writers at a time. It is 2 although only one writes, because iceoryx2's network
    /// tunnel takes the other place.
    pub publishers: usize,
    /// Samples that wait for a reader. Beyond that the oldest is dropped (safe overflow), so a
    /// writer never waits.
    pub buffer: usize,
    /// Samples that a reader may hold at a time.
    pub borrowed: usize,
    /// Past samples that a late reader receives.
    pub history: usize,
}

/// Images and point clouds. Their history is 0, because otherwise the next reader of a topic that
/// nobody read for a minute would receive a frame that is a minute old.
pub const FRAME: Qos = Qos {
    readers: 8,
    publishers: 2,
    buffer: 2,
    borrowed: 3,
    history: 0,
};
/// Images and point clouds that stay on a GPU.
pub const GPU_FRAME: Qos = Qos {
    readers: 2,
    ..FRAME
};
/// Readers that a topic of a sensor spawned at run time can have: the first number whose segment
/// stays within [`RUN_TIME_TOPIC_BYTES`], or else the last.
pub const RUN_TIME_FRAME_READERS: [usize; 3] = [16, 8, 4];
/// Shared memory that a topic of a sensor spawned at run time may take for more readers than the
/// fewest, bytes: there may be many such sensors.
pub const RUN_TIME_TOPIC_BYTES: u64 = 64 << 20;
/// Frames of IMU, GNSS and the event sensors, which are small and frequent.
pub const SMALL_FRAME: Qos = Qos {
    readers: 16,
    publishers: 2,
    buffer: 16,
    borrowed: 4,
    history: 0,
};
/// `world/snapshot`.
pub const SNAPSHOT: Qos = Qos {
    readers: 16,
    publishers: 2,
    buffer: 16,
    borrowed: 4,
    history: 1,
};
/// `world/info`, `world/map`, `world/actors`, `world/catalogue`, `world/spawn_points`.
pub const DOCUMENT: Qos = Qos {
    readers: 16,
    publishers: 2,
    buffer: 2,
    borrowed: 2,
    history: 1,
};
/// `control/vehicles` and `control/ack`. Besides the daemon, drivers that share the vehicles read
/// each other's controls.
pub const CONTROL: Qos = Qos {
    readers: 8,
    publishers: 32,
    buffer: 64,
    borrowed: 4,
    history: 0,
};
/// `world/complete`. Whoever takes part in lockstep reads it; the newest record says all.
pub const COMPLETE: Qos = Qos {
    readers: 32,
    publishers: 2,
    buffer: 2,
    borrowed: 2,
    history: 0,
};
/// `control/scene`. A worker takes all that waits before it sends frames, to see whether they are
/// still its own to send.
pub const SCENE: Qos = Qos {
    readers: 16,
    publishers: 2,
    buffer: 8,
    borrowed: 10,
    history: 0,
};
/// `control/rendered`.
pub const RENDERED: Qos = Qos {
    readers: 4,
    publishers: 16,
    buffer: 16,
    borrowed: 4,
    history: 0,
};

/// Results that are lists or texts: boxes, tracks, a path.
pub const RESULT: Qos = SMALL_FRAME;
/// Results as large as images: pixels, tensors, point clouds, bytes of unknown size. One more of
/// them may wait than of a frame, because several users' programs rarely keep a steady pace.
pub const LARGE_RESULT: Qos = Qos { buffer: 4, ..FRAME };

/// Processes that may open one service.
pub const MAX_NODES: usize = 64;
/// Listeners of one event service.
pub const EVENT_LISTENERS: usize = 32;
/// Notifiers of one event service.
pub const EVENT_NOTIFIERS: usize = 32;
/// Clients of `control/world`.
pub const COMMAND_CLIENTS: usize = 32;
/// Servers of `control/world`; 2 for the reason given at [`Qos::publishers`].
pub const COMMAND_SERVERS: usize = 2;
/// Requests of one client that may wait for their answers.
pub const COMMAND_ACTIVE: usize = 4;
/// Frames that a writer usually has in flight, for example on the GPU.
pub const FRAMES_IN_FLIGHT: usize = 2;
/// Loans beyond the frames in flight, so that one can be filled while the oldest of the others is
/// being sent.
pub const SPARE_LOANS: usize = 1;

/// Loans of a publisher that asks for no number of its own: iceoryx2's default.
pub(crate) const USUAL_LOANS: usize = 2;

/// Most samples that a reader passes over in one call to find the newest: more than wait in any
/// buffer of all writers together, so only a flood is longer.
pub(crate) const MAX_PASSED_OVER: usize = 256;

/// Longest text of a request or an answer that is parsed, bytes.
pub const MAX_COMMAND_BYTES: usize = 16 << 20;

/// Longest requests that are taken in one turn of the daemon's loop, bytes together; one is always
/// taken. The others wait for the next turn.
pub const MAX_TURN_REQUEST_BYTES: usize = 16 << 20;

/// Longest requests of one client that are taken in one turn, bytes together; one is always taken.
pub const MAX_TURN_CLIENT_BYTES: usize = 64 << 10;

/// Vehicle controls of all writers after which the rest waits for the next tick, bytes.
pub const MAX_TURN_CONTROL_BYTES: usize = 16 << 20;

impl Qos {
    /// The capacity for frames of `modality`.
    pub const fn of(modality: schema_frames::Modality) -> Qos {
        use schema_frames::SensorKind::*;
        match modality.sensor_kind() {
            Imu | Gnss | Event => SMALL_FRAME,
            Camera | Lidar | Radar => FRAME,
        }
    }

    /// The capacity for results of type `kind`.
    pub const fn of_results(kind: schema_frames::ResultType) -> Qos {
        if kind.is_large() {
            LARGE_RESULT
        } else {
            RESULT
        }
    }

    /// Slots in a writer's segment: the samples that wait for readers, that readers hold, that are
    /// kept for late readers, and that the writer has loaned.
    pub const fn slots(&self, loaned: usize) -> usize {
        self.readers * (self.buffer + self.borrowed) + self.history + loaned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_topic_with_two_frames_in_flight_has_43_slots() {
        assert_eq!(FRAME.slots(FRAMES_IN_FLIGHT + SPARE_LOANS), 43);
    }
}
