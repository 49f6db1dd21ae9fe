//! Both ends of the socket of GPU frames: a writer of ours that is asked anything, and a reader of
//! ours that is answered anything.

use std::io::{Read as _, Write as _};
use std::os::fd::{AsRawFd as _, OwnedFd};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use nix::sys::socket::{
    AddressFamily, Backlog, MsgFlags, SockFlag, SockType, UnixAddr, accept, bind, connect, listen,
    recv, send, socket,
};
use schema_bus::{Bus, BusOptions, FrameTopic, GpuDevice, GpuServer, GpuTopic, SharedMemory};
use schema_frames::{GPU_MAGIC, GpuAnswer, GpuAsk, SCHEMA_VERSION};

/// The topic that is offered and asked for.
pub const TOPIC: &str = "ego/front/rgb";
/// Domain of the writer that is asked.
const ASKED: &str = "asked";
/// Domain of the reader that is answered.
const ANSWERED: &str = "answered";

/// A private place on the bus with both.
#[derive(Debug)]
pub struct Peers {
    // Ports go before their bus, and all before the folder.
    _topic: GpuTopic,
    _memory: SharedMemory,
    server: GpuServer,
    _writer: Bus,
    reader: Bus,
    answer: Arc<Mutex<Vec<u8>>>,
    folder: tempfile::TempDir,
}

fn fresh() -> OwnedFd {
    let kind = SockType::SeqPacket;
    socket(AddressFamily::Unix, kind, SockFlag::SOCK_CLOEXEC, None).expect("a socket")
}

/// A socket's address, short whatever the folder's path.
fn address(folder: &std::fs::File, name: &str) -> UnixAddr {
    let path = format!("/proc/self/fd/{}/{name}", folder.as_raw_fd());
    UnixAddr::new(path.as_str()).expect("a short path")
}

fn sockets_below(root: &Path) -> std::fs::File {
    std::fs::File::open(root.join("gantry-gpu")).expect("the writer made the folder")
}

impl Peers {
    /// Opens the place, and lets a thread answer in the place of a writer.
    ///
    /// # Panics
    /// If the machine gives no sockets or no shared memory.
    pub fn new() -> Peers {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let root = folder.path().join("iceoryx2");
        let options = BusOptions {
            iceoryx_root: Some(root.clone()),
            prefix: Some(format!("gf{}_", std::process::id())),
        };
        let open = |domain| Bus::open_with(domain, "fuzz", &options).expect("a private place");
        let (writer, reader) = (open(ASKED), open(ANSWERED));
        let server = writer.gpu_server(GpuDevice::default());
        let server = server.expect("a socket");
        let topic = server.offer(TOPIC, FrameTopic::on_gpu(2));
        let memory = std::fs::File::open("/dev/null").expect("it is always there");
        let memory = server.share(memory.into(), 4096, GpuAnswer::VULKAN);
        let answer = Arc::new(Mutex::new(Vec::new()));
        let listener = fresh();
        let sockets = sockets_below(&root);
        let place = address(&sockets, &format!("{ANSWERED}-{:016x}", 7));
        bind(listener.as_raw_fd(), &place).expect("a new name");
        listen(&listener, Backlog::new(8).expect("a few")).expect("it is bound");
        let said = answer.clone();
        std::thread::spawn(move || {
            while let Ok(connection) = accept(listener.as_raw_fd()) {
                answer_one(connection, &said);
            }
        });
        Peers {
            _topic: topic,
            _memory: memory.expect("random numbers"),
            server,
            _writer: writer,
            reader,
            answer,
            folder,
        }
    }

    /// Asks the writer. Records of the right length are answered, others are not.
    ///
    /// # Panics
    /// If the writer does otherwise.
    pub fn ask(&self, bytes: &[u8]) {
        if bytes.is_empty() {
            return;
        }
        let root = self.folder.path().join("iceoryx2");
        let name = format!("{ASKED}-{:016x}", self.server.producer());
        let peer = fresh();
        connect(peer.as_raw_fd(), &address(&sockets_below(&root), &name)).expect("it listens");
        let mut peer = std::fs::File::from(peer);
        peer.write_all(bytes).expect("a record is taken whole");
        let mut answer = [0; 4096];
        // A connection that was closed with something unread is reset.
        let n_bytes = peer.read(&mut answer).unwrap_or(0);
        let expected = if bytes.len() == size_of::<GpuAsk>() {
            size_of::<GpuAnswer>()
        } else {
            0
        };
        assert_eq!(n_bytes, expected, "answered {} bytes", bytes.len());
        if n_bytes > 0 {
            let answer: GpuAnswer = bytemuck::pod_read_unaligned(&answer[..n_bytes]);
            let versions = (answer.magic, answer.schema_version);
            assert_eq!(versions, (GPU_MAGIC, SCHEMA_VERSION));
        }
    }

    /// Lets the reader ask, and answers with these bytes.
    ///
    /// # Panics
    /// If the reader's complaint is no sentence.
    pub fn answer(&self, bytes: &[u8]) {
        let mut answer = self.answer.lock().unwrap_or_else(PoisonError::into_inner);
        answer.clear();
        answer.extend_from_slice(bytes);
        drop(answer);
        match self.reader.gpu_offer(TOPIC) {
            Ok(offer) => assert_eq!(
                (offer.producer, bytes.len()),
                (7, size_of::<GpuAnswer>()),
                "an answer of another length was taken"
            ),
            Err(error) => assert!(error.to_string().contains(' '), "{error}"),
        }
    }
}

impl Default for Peers {
    fn default() -> Peers {
        Peers::new()
    }
}

/// Reads a question, and says what is to be said. nix hands out the connection as a number.
fn answer_one(connection: i32, said: &Mutex<Vec<u8>>) {
    let _ = recv(connection, &mut [0; 4096], MsgFlags::empty());
    let bytes = said.lock().unwrap_or_else(PoisonError::into_inner).clone();
    if !bytes.is_empty() {
        let _ = send(connection, &bytes, MsgFlags::MSG_NOSIGNAL);
    }
    let _ = nix::unistd::close(connection);
}
