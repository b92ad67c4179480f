//! Buffers that the kernel fills and lends: allocated and mapped once, then given to and fro.
//!
//! A token owns each dequeued buffer: [`Queue::dequeue`] makes a [`Filled`], which is neither copied nor made
//! elsewhere, and [`Queue::requeue`] takes it back. While the token exists, the driver does not write to the buffer, so
//! its bytes can be read.

use super::abi::FLAG_ERROR;
use super::calls::{self, BufferState};
use rustix::fd::{AsFd, BorrowedFd, OwnedFd};
use rustix::io::Errno;
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU64, Ordering};

/// Fewest buffers that a stream can go on with: one with us, one that is filled, one that waits.
const MIN_BUFFERS: u32 = 3;
/// Largest buffer, bytes: two images of 4096 x 4096 in 16 bits.
const MAX_BUFFER_BYTES: usize = 1 << 26;

/// A mapping of a buffer, to be read.
#[derive(Debug)]
struct Mapping {
    start: NonNull<u8>,
    bytes: usize,
}

// SAFETY: the address is that of memory shared with the kernel, the same in every thread; it is unmapped once, on drop.
#[allow(unsafe_code)]
unsafe impl Send for Mapping {}

#[allow(unsafe_code)]
impl Mapping {
    fn new(fd: BorrowedFd<'_>, offset: u32, bytes: usize) -> Result<Self, Errno> {
        // SAFETY: the kernel chooses the address, so that no memory of ours is mapped over; length is above 0.
        let start = unsafe {
            mmap(std::ptr::null_mut(), bytes, ProtFlags::READ, MapFlags::SHARED, fd, offset.into())?
        };
        NonNull::new(start.cast()).map(|start| Self { start, bytes }).ok_or(Errno::NOMEM)
    }

    /// The bytes.
    ///
    /// # Safety
    /// The caller ensures that nothing writes to the buffer while the bytes are borrowed: it is dequeued, and not
    /// queued again.
    unsafe fn read(&self) -> &[u8] {
        // SAFETY: `start` and `bytes` are a mapping that lives as long as `self`; nobody writes, as the caller says.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.bytes) }
    }
}

#[allow(unsafe_code)]
impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: this mapping is ours; slices of it borrow `self`, so there are none any more.
        let _ = unsafe { munmap(self.start.as_ptr().cast(), self.bytes) };
    }
}

/// A buffer that is full, and ours until it is given back.
#[derive(Debug)]
#[must_use = "a buffer that is not given back is lost to the driver"]
pub(crate) struct Filled {
    queue: u64,
    index: usize,
    bytes_used: usize,
    data_offset: usize,
    /// Flags of the buffer, `FLAG_...`.
    pub(crate) flags: u32,
    /// Counts what the sensor produced since the stream began; wraps.
    pub(crate) sequence: u32,
    /// Stamp as the driver gave it, ns of its clock.
    pub(crate) stamp_ns: i64,
}

impl Filled {
    /// True if the driver marks the data as damaged.
    pub(crate) fn is_damaged(&self) -> bool {
        self.flags & FLAG_ERROR != 0
    }
}

/// The streaming buffers of a device. Dropping it stops the stream.
#[derive(Debug)]
pub(crate) struct Queue {
    // In the order in which they are dropped: unmapped before the device is closed.
    buffers: Vec<Mapping>,
    is_ours: Vec<bool>,
    kind: u32,
    id: u64,
    fd: OwnedFd,
}

/// Tells queues apart, so that a token of another one opens nothing.
static NEXT_ID: AtomicU64 = AtomicU64::new(0);

impl Queue {
    /// Allocates and maps about `count` buffers, gives them all to the driver and starts the stream.
    pub(crate) fn start(fd: OwnedFd, kind: u32, count: usize) -> Result<Self, Errno> {
        let granted = calls::request_buffers(fd.as_fd(), kind, count as u32)?;
        if granted < MIN_BUFFERS {
            return Err(Errno::NOMEM);
        }
        let mut buffers = Vec::with_capacity(granted as usize);
        for index in 0..granted {
            let BufferState { offset, length, .. } = calls::query_buffer(fd.as_fd(), kind, index)?;
            let bytes = length as usize;
            if bytes == 0 || bytes > MAX_BUFFER_BYTES {
                return Err(Errno::FBIG);
            }
            buffers.push(Mapping::new(fd.as_fd(), offset, bytes)?);
        }
        for index in 0..granted {
            calls::queue_buffer(fd.as_fd(), kind, index)?;
        }
        calls::stream(fd.as_fd(), kind, true)?;
        let id = NEXT_ID.fetch_add(1, Ordering::Relaxed);
        Ok(Self { is_ours: vec![false; buffers.len()], buffers, kind, id, fd })
    }

    /// Buffers that there are.
    pub(crate) fn len(&self) -> usize {
        self.buffers.len()
    }

    /// Takes the next full buffer, `None` when there is none yet.
    pub(crate) fn dequeue(&mut self) -> Result<Option<Filled>, Errno> {
        let state = match calls::dequeue_buffer(self.fd.as_fd(), self.kind) {
            Err(Errno::AGAIN) => return Ok(None),
            state => state?,
        };
        let index = state.index as usize;
        match self.is_ours.get_mut(index) {
            // A driver that lends a buffer twice, or one that there is not, is not to be read from.
            None | Some(true) => return Err(Errno::IO),
            Some(is_ours) => *is_ours = true,
        }
        let (seconds, microseconds) = state.stamp;
        Ok(Some(Filled {
            queue: self.id,
            index,
            bytes_used: state.bytes_used as usize,
            data_offset: state.data_offset as usize,
            flags: state.flags,
            sequence: state.sequence,
            stamp_ns: seconds.saturating_mul(1_000_000_000).saturating_add(microseconds.saturating_mul(1000)),
        }))
    }

    /// Bytes that the driver wrote into a buffer: never more than it states, or than there are.
    #[allow(unsafe_code)]
    pub(crate) fn bytes(&self, filled: &Filled) -> &[u8] {
        assert_eq!(filled.queue, self.id, "the token is of another queue");
        // SAFETY: there is one token for each buffer that was dequeued, since `dequeue` makes it only where `is_ours`
        // was false; it is borrowed as long as `self` is for the slice, and `requeue` takes both away. So the buffer
        // stays dequeued, and a driver writes only to those that are queued.
        let bytes = unsafe { self.buffers[filled.index].read() };
        let end = filled.bytes_used.min(bytes.len());
        &bytes[filled.data_offset.min(end)..end]
    }

    /// Gives a buffer back to the driver.
    pub(crate) fn requeue(&mut self, filled: Filled) -> Result<(), Errno> {
        assert_eq!(filled.queue, self.id, "the token is of another queue");
        self.is_ours[filled.index] = false;
        calls::queue_buffer(self.fd.as_fd(), self.kind, filled.index as u32)
    }
}

impl AsFd for Queue {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }
}

impl Drop for Queue {
    fn drop(&mut self) {
        // Fails for a device that is gone; closing it does what is left.
        let _ = calls::stream(self.fd.as_fd(), self.kind, false);
    }
}
