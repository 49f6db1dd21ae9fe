//! Tells the gateways of a domain where a Traffic Manager listens: one document per port at which
//! clients look for it. The document ends with the process, however that ends.

use std::net::{IpAddr, Ipv4Addr, TcpListener, UdpSocket};

use anyhow::Context as _;
use consumer_rpc::place::{Place, topic};
use schema_bus::{Bus, DocumentPublisher};

/// Where a listener can be reached. Of one that listens everywhere, the address by which other
/// machines know this one.
pub(super) fn place_of(listener: &TcpListener) -> anyhow::Result<Place> {
    let at = listener.local_addr().context("cannot tell the port")?;
    let address = if at.ip().is_unspecified() {
        outward().unwrap_or(IpAddr::V4(Ipv4Addr::LOCALHOST))
    } else {
        at.ip()
    };
    Ok(Place {
        host: address.to_string(),
        port: at.port(),
    })
}

/// The address of this machine on its network. Nothing is sent.
fn outward() -> Option<IpAddr> {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).ok()?;
    socket.connect((Ipv4Addr::new(192, 0, 2, 1), 9)).ok()?;
    socket.local_addr().ok().map(|at| at.ip())
}

/// The document of one port.
#[derive(Debug)]
pub(super) struct Notice(DocumentPublisher);

impl Notice {
    pub fn open(bus: &Bus, port: u16, place: &Place) -> anyhow::Result<Notice> {
        let name = topic(port);
        anyhow::ensure!(
            !bus.publisher_alive(&name)?,
            "another gantry-drive serves port {port} on this domain; choose another with --serve"
        );
        let mut document = bus.document_publisher(&name)?;
        document.send_json(place, 0, 0)?;
        Ok(Notice(document))
    }

    /// Sends it to gateways that have started since.
    pub fn greet(&self) {
        self.0.greet();
    }
}
