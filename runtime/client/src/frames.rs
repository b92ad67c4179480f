//! Frames for `plumbline fly`, over the socket of `driver.frames`.

use crate::error::ClientError;
use crate::socket::{connect, send_all};
use plumbline_config::{ImageView, Timestamp};
use plumbline_protocol::frame_header::FrameHeader;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

/// Time within which a flight takes a frame: it sends away a program that takes longer.
const SEND_LIMIT: Duration = Duration::from_secs(1);

/// Connection that frames are sent over. After an error it stays closed: the flight expects whole frames.
#[derive(Debug)]
pub struct FrameSender {
    stream: Option<UnixStream>,
    bytes: Vec<u8>,
}

impl FrameSender {
    /// Connects to the socket at `path` (`driver.frames.listen` of the flight), which may come into being within `patience`.
    ///
    /// # Errors
    /// When no flight listens there.
    pub fn connect(path: impl AsRef<Path>, patience: Duration) -> Result<Self, ClientError> {
        Ok(Self { stream: Some(connect(path.as_ref(), patience)?), bytes: Vec::new() })
    }

    /// Sends a frame: its number as the camera counts, the middle of its exposure by CLOCK_MONOTONIC, and its images, left
    /// first, of the sizes that the flight's configuration has. Nothing is allocated after the first frame.
    ///
    /// # Errors
    /// When the frame has no image, or the flight has gone. It disconnects a program that sends images of other sizes.
    pub fn send(
        &mut self,
        sequence: u64,
        stamp: Timestamp,
        images: [Option<ImageView<'_>>; 2],
    ) -> Result<(), ClientError> {
        if images.iter().all(Option::is_none) {
            return Err(ClientError::NoImage);
        }
        let stream = self.stream.take().ok_or(ClientError::Closed)?;
        let side = |pixels: usize| u32::try_from(pixels).unwrap_or(u32::MAX);
        let size =
            |image: &Option<ImageView<'_>>| image.map_or((0, 0), |i| (side(i.width()), side(i.height())));
        let header = FrameHeader {
            sequence,
            stamp_ns: stamp.as_nanos(),
            sizes_px: [size(&images[0]), size(&images[1])],
        };
        self.bytes.clear();
        self.bytes.extend(header.encode());
        images.iter().flatten().flat_map(ImageView::rows).for_each(|row| self.bytes.extend_from_slice(row));
        send_all(&stream, &self.bytes, SEND_LIMIT)?;
        self.stream = Some(stream);
        Ok(())
    }
}
