//! A client of the gateway that listens to an IMU over and over, as CARLA's library does, and looks
//! at every byte that it is sent.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::Duration;

use consumer_rpc::fields::Fields;
use consumer_rpc::list;
use consumer_rpc::msgpack::{self, Limits, Value};

/// Bytes before a sensor's payload: type, frame, time, place.
const HEADER_BYTES: usize = 48;
/// The IMU's number among the types of sensors.
const IMU: u64 = 5;
/// Of `(acceleration, rotation, compass)`, how many bytes at most.
const MOST_BYTES: usize = HEADER_BYTES + 64;

/// A connection for calls, with an IMU of its own.
pub struct Listener {
    calls: TcpStream,
    n_calls: u32,
    stream: u32,
}

/// Connects to a port of this machine; reads wait for a minute at most.
pub fn connect(port: u16) -> TcpStream {
    let connection = TcpStream::connect(("127.0.0.1", port)).unwrap();
    connection
        .set_read_timeout(Some(Duration::from_secs(60)))
        .unwrap();
    connection
}

/// Bytes of a request.
pub fn request(id: u32, method: &str, args: &[Value]) -> Vec<u8> {
    let mut all = vec![list![false]];
    all.extend_from_slice(args);
    let mut bytes = Vec::new();
    msgpack::write(&mut bytes, &list![0u32, id, method, Value::Array(all)]);
    bytes
}

/// Number and port of a token's stream.
fn parts(token: &Value) -> (u32, u16) {
    let Value::Bin(bytes) = token else {
        panic!("{token:?} is no token");
    };
    assert_eq!(bytes.len(), 24);
    let stream = u32::from_le_bytes(bytes[..4].try_into().unwrap());
    let port = u16::from_le_bytes(bytes[4..6].try_into().unwrap());
    (stream, port)
}

impl Listener {
    /// Spawns an IMU.
    pub fn new(port: u16) -> Listener {
        let mut listener = Listener {
            calls: connect(port),
            n_calls: 0,
            stream: 0,
        };
        let origin = list![list![0.0f32, 0.0f32, 2.0f32], list![0.0f32, 0.0f32, 0.0f32]];
        let imu = list![1u32, "sensor.other.imu", list![]];
        let Value::Array(actor) = listener.call("spawn_actor", &[imu, origin]) else {
            panic!("no actor");
        };
        listener.stream = parts(&actor[5]).0;
        listener
    }

    /// Calls a method and returns its result, which comes as `[1, value]`; an error would be `[0, error]`.
    fn call(&mut self, method: &str, args: &[Value]) -> Value {
        self.n_calls += 1;
        let bytes = request(self.n_calls, method, args);
        self.calls.write_all(&bytes).unwrap();
        let answer = msgpack::read(&mut self.calls, Limits::default()).unwrap();
        let Value::Array(items) = answer else {
            panic!("{method}: {answer:?} is no answer");
        };
        let mut fields = Fields::new("an answer", &items);
        assert_eq!(fields.u32().unwrap(), 1, "{method}: {items:?}");
        assert_eq!(fields.u32().unwrap(), self.n_calls, "{method}: {items:?}");
        assert_eq!(fields.value().unwrap(), &Value::Nil, "{method}: {items:?}");
        let result = fields.value().unwrap();
        let Value::Array(result) = result else {
            panic!("{method}: {result:?} is no result");
        };
        let [Value::Array(either)] = result.as_slice() else {
            panic!("{method}: {result:?} is no result");
        };
        assert_eq!(either[0], Value::UInt(1), "{method}: {either:?}");
        either[1].clone()
    }

    /// Listens, takes so many messages, and stops.
    pub fn listen(&mut self, n_messages: usize) {
        let stream = self.stream;
        let token = self.call("get_sensor_token", &[stream.into()]);
        let Value::Array(token) = token else {
            panic!("{token:?} is no token");
        };
        let (of, port) = parts(&token[0]);
        assert_eq!(of, stream);
        let mut connection = connect(port);
        connection.write_all(&of.to_le_bytes()).unwrap();
        let mut last_frame = 0;
        for _ in 0..n_messages {
            let frame = read_imu(&mut connection);
            assert!(frame > last_frame, "{frame} after {last_frame}");
            last_frame = frame;
        }
    }
}

/// Reads a message, which must be an IMU's from its first byte to its last, and returns its frame.
fn read_imu(connection: &mut TcpStream) -> u64 {
    let mut length = [0; 4];
    connection.read_exact(&mut length).unwrap();
    let length = u32::from_le_bytes(length) as usize;
    assert!((HEADER_BYTES..=MOST_BYTES).contains(&length), "{length}");
    let mut message = vec![0; length];
    connection.read_exact(&mut message).unwrap();
    let word = |at: usize| u64::from_le_bytes(message[at..at + 8].try_into().unwrap());
    assert_eq!(word(0), IMU);
    let mut payload = &message[HEADER_BYTES..];
    let Value::Array(items) = msgpack::read(&mut payload, Limits::default()).unwrap() else {
        panic!("{payload:?} is no list");
    };
    assert!(payload.is_empty(), "{} bytes too many", payload.len());
    let mut fields = Fields::new("an IMU's message", &items);
    fields.vector().unwrap();
    fields.vector().unwrap();
    assert!(matches!(fields.value().unwrap(), Value::F32(_)));
    assert!(fields.rest().is_empty());
    word(8)
}
