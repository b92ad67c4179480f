//
// Copyright (c) 2023 ZettaScale Technology
//
// This program and the accompanying materials are made available under the
// terms of the Eclipse Public License 2.0 which is available at
// http://www.eclipse.org/legal/epl-2.0, or the Apache License, Version 2.0
// which is available at https://www.apache.org/licenses/LICENSE-2.0.
//
// SPDX-License-Identifier: EPL-2.0 OR Apache-2.0
//
// Contributors:
//   ZettaScale Zenoh Team, <zenoh@zettascale.tech>
//
#[cfg(all(feature = "uring", target_os = "linux"))]
use std::os::fd::{AsRawFd, RawFd};
use std::{
    collections::HashMap,
    fmt,
    net::{Ipv4Addr, Ipv6Addr, SocketAddr},
    sync::{Arc, Mutex, Weak},
    time::{Duration, Instant},
};

use async_trait::async_trait;
use tokio::{
    net::UdpSocket,
    sync::{mpsc, Mutex as AsyncMutex},
};
use tokio_util::sync::CancellationToken;
use zenoh_core::{zasynclock, zlock};
use zenoh_link_commons::{
    get_ip_addrs, get_ip_interface_names, parse_dscp, set_dscp, ConstructibleLinkManagerUnicast,
    LinkAuthId, LinkManagerUnicastTrait, LinkUnicast, LinkUnicastTrait, ListenersUnicastIP,
    LocatorInspector, NewLinkChannelSender, BIND_INTERFACE, BIND_SOCKET,
};
use zenoh_protocol::{
    core::{Address, EndPoint, Locator, Priority},
    transport::BatchSize,
};
use zenoh_result::{bail, zerror, Error as ZError, ZResult};

use super::{socket_addr_to_udp_locator, UDP_ACCEPT_THROTTLE_TIME, UDP_DEFAULT_MTU, UDP_MAX_MTU};
use crate::{
    handshakes::{Handshake, Handshakes}, // PLUMBLINE
    pktinfo,
    reliability::LinkUnicastQuicUnsecure,
};

/// PLUMBLINE: links by their addresses, each with a number of its own. The published version holds weak references to the links, and
/// one slot for a datagram in each, for which it waits: where a link went while a datagram waited for its slot, the listener waited for ever.
type LinkHashMap = Arc<Mutex<HashMap<(SocketAddr, SocketAddr), (u64, mpsc::Sender<Vec<u8>>)>>>;

/// PLUMBLINE: datagrams that wait to be read by a link; what comes beyond is lost, as datagrams may be.
const WAITING: usize = 32;
/// PLUMBLINE: a listener waits this long for a link that has so many.
const PATIENCE: Duration = Duration::from_millis(2);
/// PLUMBLINE: datagrams of a handshake.
const READS: usize = 2;
/// PLUMBLINE: handshakes at a time, of all listeners. The source of a datagram can be forged, so they are more than those of streams.
const MAX_HANDSHAKES: usize = 512;

struct LinkUnicastUdpConnected {
    socket: Arc<UdpSocket>,
}

impl LinkUnicastUdpConnected {
    async fn read(&self, buffer: &mut [u8]) -> ZResult<usize> {
        self.socket
            .recv(buffer)
            .await
            .map_err(|e| zerror!(e).into())
    }

    async fn write(&self, buffer: &[u8]) -> ZResult<usize> {
        self.socket
            .send(buffer)
            .await
            .map_err(|e| zerror!(e).into())
    }

    async fn close(&self) -> ZResult<()> {
        Ok(())
    }
}

/// PLUMBLINE: what a link has received and not read: datagrams, and the rest of one.
struct Input {
    datagrams: mpsc::Receiver<Vec<u8>>,
    leftover: Option<(Vec<u8>, usize)>,
}

struct LinkUnicastUdpUnconnected {
    socket: Weak<UdpSocket>,
    links: LinkHashMap,
    addresses: (SocketAddr, SocketAddr),
    id: u64,
    input: AsyncMutex<Input>,
    handshake: Handshake,
}

impl LinkUnicastUdpUnconnected {
    async fn read(&self, buffer: &mut [u8]) -> ZResult<usize> {
        let mut input = zasynclock!(self.input);
        let (datagram, start) = match input.leftover.take() {
            Some(leftover) => leftover,
            None => {
                let receive = async { input.datagrams.recv().await.ok_or_else(|| zerror!("link is closed").into()) };
                (self.handshake.read(receive).await?, 0)
            }
        };
        // Copy the read bytes into the target buffer
        let end = datagram.len().min(start + buffer.len());
        buffer[..end - start].copy_from_slice(&datagram[start..end]);
        if end < datagram.len() {
            input.leftover = Some((datagram, end));
        }
        // Return the amount read
        Ok(end - start)
    }

    async fn write(&self, buffer: &[u8], dst_addr: SocketAddr) -> ZResult<usize> {
        match self.socket.upgrade() {
            Some(socket) => socket
                .send_to(buffer, &dst_addr)
                .await
                .map_err(|e| zerror!(e).into()),
            None => bail!("UDP listener has been dropped"),
        }
    }

    /// Deletes the link from the list of links, unless its addresses are another one's by now.
    fn close(&self) {
        let mut links = zlock!(self.links);
        if links.get(&self.addresses).is_some_and(|(id, _)| *id == self.id) {
            links.remove(&self.addresses);
        }
    }
}

impl Drop for LinkUnicastUdpUnconnected {
    fn drop(&mut self) {
        self.close();
    }
}

#[allow(private_interfaces)]
pub(crate) enum LinkUnicastUdpVariant {
    Connected(LinkUnicastUdpConnected),
    Unconnected(Box<LinkUnicastUdpUnconnected>),
    Reliable(Box<LinkUnicastQuicUnsecure>),
}

pub struct LinkUnicastUdp {
    // The source socket address of this link (address used on the local host)
    src_addr: SocketAddr,
    src_locator: Locator,
    // The destination socket address of this link (address used on the remote host)
    dst_addr: SocketAddr,
    dst_locator: Locator,
    // The UDP socket is connected to the peer
    variant: LinkUnicastUdpVariant,
}

impl LinkUnicastUdp {
    pub(crate) fn new(
        src_addr: SocketAddr,
        dst_addr: SocketAddr,
        variant: LinkUnicastUdpVariant,
    ) -> LinkUnicastUdp {
        LinkUnicastUdp {
            src_locator: socket_addr_to_udp_locator(&src_addr),
            dst_locator: socket_addr_to_udp_locator(&dst_addr),
            src_addr,
            dst_addr,
            variant,
        }
    }
}

#[async_trait]
impl LinkUnicastTrait for LinkUnicastUdp {
    async fn close(&self) -> ZResult<()> {
        tracing::trace!("Closing UDP link: {}", self);
        match &self.variant {
            LinkUnicastUdpVariant::Connected(link) => link.close().await,
            LinkUnicastUdpVariant::Unconnected(link) => {
                link.close();
                Ok(())
            }
            LinkUnicastUdpVariant::Reliable(link) => {
                link.close();
                Ok(())
            }
        }
    }

    async fn write(&self, buffer: &[u8], priority: Option<Priority>) -> ZResult<usize> {
        match &self.variant {
            LinkUnicastUdpVariant::Connected(link) => link.write(buffer).await,
            LinkUnicastUdpVariant::Unconnected(link) => link.write(buffer, self.dst_addr).await,
            LinkUnicastUdpVariant::Reliable(link) => link.write(buffer, priority).await,
        }
    }

    async fn write_all(&self, buffer: &[u8], priority: Option<Priority>) -> ZResult<()> {
        match &self.variant {
            LinkUnicastUdpVariant::Reliable(link) => link.write_all(buffer, priority).await,
            LinkUnicastUdpVariant::Connected(_) | LinkUnicastUdpVariant::Unconnected(_) => {
                let mut written: usize = 0;
                while written < buffer.len() {
                    written += self.write(&buffer[written..], priority).await?;
                }
                Ok(())
            }
        }
    }

    async fn read(&self, buffer: &mut [u8], priority: Option<Priority>) -> ZResult<usize> {
        match &self.variant {
            LinkUnicastUdpVariant::Connected(link) => link.read(buffer).await,
            LinkUnicastUdpVariant::Unconnected(link) => link.read(buffer).await,
            LinkUnicastUdpVariant::Reliable(link) => link.read(buffer, priority).await,
        }
    }

    async fn read_exact(&self, buffer: &mut [u8], priority: Option<Priority>) -> ZResult<()> {
        match &self.variant {
            LinkUnicastUdpVariant::Reliable(link) => link.read_exact(buffer, priority).await,
            LinkUnicastUdpVariant::Connected(_) | LinkUnicastUdpVariant::Unconnected(_) => {
                let mut read: usize = 0;
                while read < buffer.len() {
                    let n = self.read(&mut buffer[read..], priority).await?;
                    read += n;
                }
                Ok(())
            }
        }
    }

    #[inline(always)]
    fn get_src(&self) -> &Locator {
        &self.src_locator
    }

    #[inline(always)]
    fn get_dst(&self) -> &Locator {
        &self.dst_locator
    }

    #[inline(always)]
    fn get_mtu(&self) -> BatchSize {
        match &self.variant {
            LinkUnicastUdpVariant::Reliable(link) => link.get_mtu(),
            LinkUnicastUdpVariant::Connected(_) | LinkUnicastUdpVariant::Unconnected(_) => {
                *UDP_DEFAULT_MTU
            }
        }
    }

    #[inline(always)]
    fn get_interface_names(&self) -> Vec<String> {
        get_ip_interface_names(&self.src_addr)
    }

    #[inline(always)]
    fn is_reliable(&self) -> bool {
        match &self.variant {
            LinkUnicastUdpVariant::Reliable(_) => true,
            LinkUnicastUdpVariant::Connected(_) | LinkUnicastUdpVariant::Unconnected(_) => {
                super::IS_RELIABLE
            }
        }
    }

    #[inline(always)]
    fn is_streamed(&self) -> bool {
        match &self.variant {
            LinkUnicastUdpVariant::Reliable(_) => true,
            LinkUnicastUdpVariant::Connected(_) | LinkUnicastUdpVariant::Unconnected(_) => false,
        }
    }

    #[inline(always)]
    fn supports_priorities(&self) -> bool {
        match &self.variant {
            LinkUnicastUdpVariant::Reliable(link) => link.supports_priorities(),
            LinkUnicastUdpVariant::Connected(_) | LinkUnicastUdpVariant::Unconnected(_) => false,
        }
    }

    #[inline(always)]
    fn get_auth_id(&self) -> &LinkAuthId {
        &LinkAuthId::Udp
    }

    #[cfg(all(feature = "uring", target_os = "linux"))]
    fn get_fd(&self) -> ZResult<RawFd> {
        let fd = match &self.variant {
            LinkUnicastUdpVariant::Connected(link_unicast_udp_connected) => {
                link_unicast_udp_connected.socket.as_raw_fd()
            }
            // Unconnected UDP sockets are shared across multiple peers and demultiplexed
            // by source address in the tokio read path. Handing the raw fd to io_uring
            // RecvMulti would bypass that demux and deliver datagrams from any peer to
            // this link. Always fall back to tokio for the unconnected case.
            LinkUnicastUdpVariant::Unconnected(_) => bail!("FD unavailable for unconnected UDP"),
            LinkUnicastUdpVariant::Reliable(_) => bail!("FD unavailable"),
        };

        match fd {
            fd if fd < 0 => bail!("FD unavailable"),
            fd => Ok(fd),
        }
    }
}

impl fmt::Display for LinkUnicastUdp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} => {}", self.src_addr, self.dst_addr)?;
        Ok(())
    }
}

impl fmt::Debug for LinkUnicastUdp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Udp")
            .field("src", &self.src_addr)
            .field("dst", &self.dst_addr)
            .finish()
    }
}

pub struct LinkManagerUnicastUdp {
    pub(crate) manager: NewLinkChannelSender,
    pub(crate) listeners: ListenersUnicastIP,
    handshakes: Handshakes, // PLUMBLINE
}

impl fmt::Debug for LinkManagerUnicastUdp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LinkManagerUnicastUdp")
            .field("manager", &self.manager)
            .field("listeners", &self.listeners)
            .finish()
    }
}

impl LinkManagerUnicastUdp {
    pub fn new(manager: NewLinkChannelSender) -> Self {
        Self {
            manager,
            listeners: ListenersUnicastIP::new(),
            handshakes: Handshakes::default(),
        }
    }
}
impl ConstructibleLinkManagerUnicast<()> for LinkManagerUnicastUdp {
    fn new(new_link_sender: NewLinkChannelSender, _: ()) -> ZResult<Self> {
        Ok(Self::new(new_link_sender))
    }
}

impl LinkManagerUnicastUdp {
    async fn new_link_inner(
        &self,
        dst_addr: &SocketAddr,
        iface: Option<&str>,
        bind_socket: Option<&str>,
        dscp: Option<u32>,
    ) -> ZResult<(UdpSocket, SocketAddr, SocketAddr)> {
        let src_socket_addr = if let Some(bind_socket) = bind_socket {
            let address = Address::from(bind_socket);
            get_ip_addrs(address)
                .await?
                .next()
                .ok_or_else(|| zerror!("No UDP socket addr found bound to {}", address))?
        } else if dst_addr.is_ipv4() {
            SocketAddr::new(Ipv4Addr::UNSPECIFIED.into(), 0)
        } else {
            SocketAddr::new(Ipv6Addr::UNSPECIFIED.into(), 0)
        };

        // Establish a UDP socket
        let socket = UdpSocket::bind(src_socket_addr).await.map_err(|e| {
            let e = zerror!(
                "Can not create a new UDP link bound to {}: {}",
                src_socket_addr,
                e
            );
            tracing::warn!("{}", e);
            e
        })?;

        if let Some(iface) = iface {
            zenoh_util::net::set_bind_to_device_udp_socket(&socket, iface)?;
        }

        if let Some(dscp) = dscp {
            set_dscp(&socket, *dst_addr, dscp)?;
        }

        // Connect the socket to the remote address
        socket.connect(dst_addr).await.map_err(|e| {
            let e = zerror!("Can not connect a new UDP link to {}: {}", dst_addr, e);
            tracing::warn!("{}", e);
            e
        })?;

        // Get source and destination UDP addresses
        let src_addr = socket.local_addr().map_err(|e| {
            let e = zerror!(
                "Can not get local_addr for UDP link bound src {}: to :{} : {}",
                src_socket_addr,
                dst_addr,
                e
            );
            tracing::warn!("{}", e);
            e
        })?;

        let dst_addr = socket.peer_addr().map_err(|e| {
            let e = zerror!(
                "Can not get peer_addr for UDP link bound src {}: to :{} : {}",
                src_socket_addr,
                dst_addr,
                e
            );
            tracing::warn!("{}", e);
            e
        })?;

        Ok((socket, src_addr, dst_addr))
    }

    async fn new_listener_inner(
        &self,
        addr: &SocketAddr,
        iface: Option<&str>,
        dscp: Option<u32>,
    ) -> ZResult<(UdpSocket, SocketAddr)> {
        // Bind the UDP socket
        let socket = UdpSocket::bind(addr).await.map_err(|e| {
            let e = zerror!("Can not create a new UDP listener on {}: {}", addr, e);
            tracing::warn!("{}", e);
            e
        })?;

        if let Some(iface) = iface {
            zenoh_util::net::set_bind_to_device_udp_socket(&socket, iface)?;
        }

        if let Some(dscp) = dscp {
            set_dscp(&socket, *addr, dscp)?;
        }

        let local_addr = socket.local_addr().map_err(|e| {
            let e = zerror!("Can not create a new UDP listener on {}: {}", addr, e);
            tracing::warn!("{}", e);
            e
        })?;

        Ok((socket, local_addr))
    }

    async fn new_udp_link(&self, endpoint: EndPoint) -> ZResult<LinkUnicast> {
        let dst_addrs = get_ip_addrs(endpoint.address())
            .await?
            .filter(|a| !a.ip().is_multicast());
        let config = endpoint.config();
        let iface = config.get(BIND_INTERFACE);

        if let (Some(_), Some(_)) = (config.get(BIND_INTERFACE), config.get(BIND_SOCKET)) {
            bail!(
                "Using Config options `iface` and `bind` in conjunction is unsupported at this time {} {:?}",
                BIND_INTERFACE,
                BIND_SOCKET
            )
        }

        let bind_socket = config.get(BIND_SOCKET);
        let dscp = parse_dscp(&config)?;

        let mut errs: Vec<ZError> = vec![];
        for da in dst_addrs {
            match self.new_link_inner(&da, iface, bind_socket, dscp).await {
                Ok((socket, src_addr, dst_addr)) => {
                    // Create UDP link
                    let link = Arc::new(LinkUnicastUdp::new(
                        src_addr,
                        dst_addr,
                        LinkUnicastUdpVariant::Connected(LinkUnicastUdpConnected {
                            socket: Arc::new(socket),
                        }),
                    ));

                    return Ok(LinkUnicast::from(link as Arc<dyn LinkUnicastTrait>));
                }
                Err(e) => {
                    errs.push(e);
                }
            }
        }

        if errs.is_empty() {
            errs.push(zerror!("No UDP unicast addresses available").into());
        }

        bail!(
            "Can not create a new UDP link bound to {}: {:?}",
            endpoint,
            errs
        )
    }

    async fn new_udp_listener(&self, mut endpoint: EndPoint) -> ZResult<Locator> {
        let addrs = get_ip_addrs(endpoint.address())
            .await?
            .filter(|a| !a.ip().is_multicast());
        let config = endpoint.config();
        let iface = config.get(BIND_INTERFACE);
        let dscp = parse_dscp(&config)?;

        let mut errs: Vec<ZError> = vec![];
        for da in addrs {
            match self.new_listener_inner(&da, iface, dscp).await {
                Ok((socket, local_addr)) => {
                    // Update the endpoint locator address
                    endpoint = EndPoint::new(
                        endpoint.protocol(),
                        local_addr.to_string(),
                        endpoint.metadata(),
                        endpoint.config(),
                    )?;

                    let token = self.listeners.token.child_token();

                    let task = {
                        let token = token.clone();
                        let manager = self.manager.clone();
                        let handshakes = self.handshakes.clone();

                        async move { accept_read_task(socket, token, manager, handshakes).await }
                    };

                    let locator = endpoint.to_locator();
                    self.listeners
                        .add_listener(endpoint, local_addr, task, token)
                        .await?;

                    return Ok(locator);
                }
                Err(e) => {
                    errs.push(e);
                }
            }
        }

        if errs.is_empty() {
            errs.push(zerror!("No UDP unicast addresses available").into());
        }

        bail!(
            "Can not create a new UDP listener bound to {}: {:?}",
            endpoint,
            errs
        )
    }
}

#[async_trait]
impl LinkManagerUnicastTrait for LinkManagerUnicastUdp {
    async fn new_link(&self, endpoint: EndPoint) -> ZResult<LinkUnicast> {
        let is_reliable = crate::UdpLocatorInspector
            .is_reliable(&endpoint.to_locator())
            .map_err(|e| {
                zerror!("Failed to parse reliability config for UDP endpoint '{endpoint}': {e:?}")
            })?;
        if is_reliable {
            LinkUnicastQuicUnsecure::connect(&endpoint).await
        } else {
            self.new_udp_link(endpoint).await
        }
    }

    async fn new_listener(&self, endpoint: EndPoint) -> ZResult<Locator> {
        let is_reliable = crate::UdpLocatorInspector
            .is_reliable(&endpoint.to_locator())
            .map_err(|e| {
                zerror!("Failed to parse reliability config for UDP endpoint '{endpoint}': {e:?}")
            })?;
        if is_reliable {
            LinkUnicastQuicUnsecure::listen(&endpoint, self).await
        } else {
            self.new_udp_listener(endpoint).await
        }
    }

    async fn del_listener(&self, endpoint: &EndPoint) -> ZResult<()> {
        let addrs = get_ip_addrs(endpoint.address())
            .await?
            .filter(|x| !x.ip().is_multicast());

        // Stop the listener
        let mut errs: Vec<ZError> = vec![];
        let mut failed = true;
        for a in addrs {
            match self.listeners.del_listener(a).await {
                Ok(_) => {
                    failed = false;
                    break;
                }
                Err(err) => {
                    errs.push(zerror!("{}", err).into());
                }
            }
        }

        if failed {
            bail!(
                "Can not delete the TCP listener bound to {}: {:?}",
                endpoint,
                errs
            )
        }
        Ok(())
    }

    async fn get_listeners(&self) -> Vec<EndPoint> {
        self.listeners.get_endpoints()
    }

    /// See [`zenoh_link_commons::ListenersUnicastIP::get_locators`].
    async fn get_locators(&self) -> Vec<Locator> {
        self.listeners.get_locators()
    }

    /// See [`zenoh_link_commons::ListenersUnicastIP::get_locators_noloopback`].
    async fn get_locators_noloopback(&self) -> Vec<Locator> {
        self.listeners.get_locators_noloopback()
    }
}

/// PLUMBLINE: links that may begin, so many at once and so many a second. In a flood of datagrams what comes beyond is dropped before it
/// costs anything, so that those that have begun have time to complete their handshakes.
struct Admission {
    tokens: f64,
    at: Instant,
}

impl Admission {
    const BURST: f64 = MAX_HANDSHAKES as f64;
    const A_SECOND: f64 = 2_000.0;

    fn new() -> Self {
        Self { tokens: Self::BURST, at: Instant::now() }
    }

    fn admits(&mut self) -> bool {
        let now = Instant::now();
        let earned = now.duration_since(self.at).as_secs_f64() * Self::A_SECOND;
        (self.tokens, self.at) = (Self::BURST.min(self.tokens + earned), now);
        let is_admitted = self.tokens >= 1.0;
        self.tokens -= f64::from(u8::from(is_admitted));
        is_admitted
    }
}

/// PLUMBLINE: whether a datagram can be the first of a link.
fn begins_a_link(datagram: &[u8]) -> bool {
    use zenoh_protocol::transport::{id, init};
    // Flags of an InitSyn are those of its size and of its extensions; the version follows.
    matches!(datagram, [header, _, _, _, ..] if header & (0x1f | init::flag::A) == id::INIT)
}

async fn accept_read_task(
    socket: UdpSocket,
    token: CancellationToken,
    manager: NewLinkChannelSender,
    handshakes: Handshakes, // PLUMBLINE
) -> ZResult<()> {
    let socket = Arc::new(socket);
    let links: LinkHashMap = Arc::new(Mutex::new(HashMap::new()));

    async fn receive(
        socket: Arc<pktinfo::PktInfoUdpSocket>,
        buffer: &mut [u8],
    ) -> ZResult<(usize, SocketAddr, SocketAddr)> {
        let res = socket.receive(buffer).await.map_err(|e| zerror!(e))?;
        Ok(res)
    }

    let local_src_addr = socket.local_addr().map_err(|e| {
        let e = zerror!("Can not accept UDP connections: {}", e);
        tracing::warn!("{}", e);
        e
    })?;
    let socket = Arc::new(pktinfo::PktInfoUdpSocket::new(socket).map_err(|e| {
        let e = zerror!("Failed to enable IP_PKTINFO: {}", e);
        tracing::warn!("{}", e);
        e
    })?);

    tracing::trace!("Ready to accept UDP connections on: {:?}", local_src_addr);

    // PLUMBLINE: a datagram is copied at its length, so that those that wait take no more memory than they have bytes.
    let mut buff = zenoh_buffers::vec::uninit(UDP_MAX_MTU as usize);
    let (mut next_id, mut admission) = (0_u64, Admission::new());
    loop {
        tokio::select! {
            _ = token.cancelled() => break,

            res = receive(socket.clone(), &mut buff) => {
                match res {
                    // PLUMBLINE: an empty datagram says nothing, and is no end of a link
                    Ok((0, ..)) => {}
                    Ok((n, dst_addr, src_addr)) => {
                        let addresses = (src_addr, dst_addr);
                        let known = zlock!(links).get(&addresses).map(|(_, link)| link.clone());
                        let input = match known.filter(|link| !link.is_closed()) {
                            Some(input) => input,
                            // PLUMBLINE: a link begins with an InitSyn; all else from a stranger is dropped before it costs anything
                            None if !begins_a_link(&buff[..n]) || !admission.admits() => continue,
                            None => {
                                // A new peers has sent data to this socket
                                tracing::debug!("Accepted UDP connection on {}: {}", src_addr, dst_addr);
                                let (input, datagrams) = mpsc::channel(WAITING);
                                next_id += 1;
                                let unconnected = LinkUnicastUdpUnconnected {
                                    socket: Arc::downgrade(&socket.socket),
                                    links: links.clone(),
                                    addresses,
                                    id: next_id,
                                    input: AsyncMutex::new(Input { datagrams, leftover: None }),
                                    handshake: handshakes.begin(dst_addr.ip(), READS, MAX_HANDSHAKES),
                                };
                                zlock!(links).insert(addresses, (next_id, input.clone()));
                                // Create the new link object
                                let link = Arc::new(LinkUnicastUdp::new(
                                    src_addr,
                                    dst_addr,
                                    LinkUnicastUdpVariant::Unconnected(Box::new(unconnected)),
                                ));
                                // Add the new link to the set of connected peers
                                if let Err(e) = manager
                                    .send_async(LinkUnicast::from(link as Arc<dyn LinkUnicastTrait>))
                                    .await
                                {
                                    tracing::error!("{}-{}: {}", file!(), line!(), e)
                                }
                                input
                            }
                        };
                        let sent = tokio::time::timeout(PATIENCE, input.send(buff[..n].to_vec())).await;
                        if !matches!(sent, Ok(Ok(()))) {
                            tracing::debug!("Dropped a datagram from {}", dst_addr);
                        }
                    }

                    Err(e) => {
                        tracing::warn!("{}. Hint: increase the system open file limit.", e);
                        // Throttle the accept loop upon an error
                        // NOTE: This might be due to various factors. However, the most common case is that
                        //       the process has reached the maximum number of open files in the system. On
                        //       Linux systems this limit can be changed by using the "ulimit" command line
                        //       tool. In case of systemd-based systems, this can be changed by using the
                        //       "sysctl" command line tool.
                        tokio::time::sleep(Duration::from_micros(*UDP_ACCEPT_THROTTLE_TIME)).await;
                    }
                }
            }
        }
    }

    Ok(())
}
