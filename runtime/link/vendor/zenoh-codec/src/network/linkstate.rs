//! PLUMBLINE: what becomes of the link states of a peer (OAM messages of id 1) before the routing tables read them.
//!
//! A link state holds lengths and node numbers, for which the tables reserve memory while their locks are held: a length of 2^62
//! panics there, a node number of 2^40 aborts the process, and well-formed ones grow a graph whose trees cost the cube of its
//! size. Who exchanges no routes with routers needs none of them: by default their content is dropped. Where they are
//! accepted, a list that claims more than its message holds is malformed, and ends the link.

use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use zenoh_buffers::{
    reader::{DidntRead, HasReader, Reader},
    ZBuf,
};
use zenoh_protocol::{
    common::{imsg, ZExtBody},
    core::{Locator, ZenohIdProto},
};

use crate::{RCodec, Zenoh080};

/// Numbers of nodes, as peers assign them one after the other, and nodes or links in one message.
const MAX_NUMBER: u64 = 10_000;
const MAX_NODES: usize = 256;
/// Options of a link state, as in zenoh's `net::protocol::linkstate`.
const PID: u64 = 1;
const WAI: u64 = 1 << 1;
const LOC: u64 = 1 << 2;
const WGT: u64 = 1 << 3;

static IS_ACCEPTED: AtomicBool = AtomicBool::new(false);
static DROPPED: AtomicU64 = AtomicU64::new(0);

/// Accepts the link states of peers in this process, for routers that exchange routes.
pub fn accept_link_states() {
    IS_ACCEPTED.store(true, Ordering::Relaxed);
}

/// Number of link states whose content was dropped so far.
pub fn dropped_link_states() -> u64 {
    DROPPED.load(Ordering::Relaxed)
}

/// The body of an OAM message of link states as the tables may read it.
pub(super) fn admit(body: ZExtBody) -> Result<ZExtBody, DidntRead> {
    if !IS_ACCEPTED.load(Ordering::Relaxed) {
        DROPPED.fetch_add(1, Ordering::Relaxed);
        return Ok(ZExtBody::Unit);
    }
    if let ZExtBody::ZBuf(list) = &body {
        check(list)?;
    }
    Ok(body)
}

/// Refuses a list with more entries than it has bytes, or with numbers that no peer needs.
fn check(list: &ZBuf) -> Result<(), DidntRead> {
    let codec = Zenoh080::new();
    let mut reader = list.reader();
    for _ in 0..bounded(&mut reader)? {
        let options: u64 = codec.read(&mut reader)?;
        let _psid = number(&mut reader)?;
        let _sn: u64 = codec.read(&mut reader)?;
        if imsg::has_option(options, PID) {
            let _zid: ZenohIdProto = codec.read(&mut reader)?;
        }
        if imsg::has_option(options, WAI) {
            let _whatami: u8 = codec.read(&mut reader)?;
        }
        if imsg::has_option(options, LOC) {
            for _ in 0..bounded(&mut reader)? {
                let _locator: Locator = codec.read(&mut reader)?;
            }
        }
        let links = bounded(&mut reader)?;
        for _ in 0..links {
            number(&mut reader)?;
        }
        if imsg::has_option(options, WGT) {
            for _ in 0..links {
                let _weight: u16 = codec.read(&mut reader)?;
            }
        }
    }
    Ok(())
}

/// A count of entries, each of which takes a byte at least.
fn bounded<R: Reader>(reader: &mut R) -> Result<usize, DidntRead> {
    let count: usize = Zenoh080::new().read(&mut *reader)?;
    if count > reader.remaining().min(MAX_NODES) {
        return Err(DidntRead);
    }
    Ok(count)
}

/// The number of a node.
fn number<R: Reader>(reader: &mut R) -> Result<u64, DidntRead> {
    let number: u64 = Zenoh080::new().read(&mut *reader)?;
    if number < MAX_NUMBER {
        Ok(number)
    } else {
        Err(DidntRead)
    }
}
