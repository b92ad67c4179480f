//! Listening sockets in the file system: made whole under another name, found in use without waiting, and taken away only by
//! whoever has made them.

use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType, connect, socket_with};
use std::fs::Permissions;
use std::io;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};

/// The file of a listening socket; dropping it removes the file, unless another one has taken its place.
#[derive(Debug)]
pub struct SocketFile {
    path: PathBuf,
    /// Device and number of the file.
    inode: (u64, u64),
}

impl SocketFile {
    /// Listens at `path` in the place of what is there. Nobody connects before the permissions are set: the socket is made under
    /// another name, given to its group by `prepare`, and takes its place whole.
    ///
    /// # Errors
    /// When the socket or its permissions cannot be made; also what `prepare` says.
    pub fn listen<E: From<io::Error>>(
        path: &Path,
        mode: u32,
        prepare: impl FnOnce(&Path) -> Result<(), E>,
    ) -> Result<(UnixListener, Self), E> {
        let mut new = path.as_os_str().to_owned();
        new.push(".new");
        let new = PathBuf::from(new);
        let _ = std::fs::remove_file(&new);
        let listener = UnixListener::bind(&new)?;
        let made = prepare(&new).and_then(|()| {
            std::fs::set_permissions(&new, Permissions::from_mode(mode))?;
            let metadata = std::fs::symlink_metadata(&new)?;
            std::fs::rename(&new, path)?;
            Ok((metadata.dev(), metadata.ino()))
        });
        if made.is_err() {
            let _ = std::fs::remove_file(&new);
        }
        Ok((listener, Self { path: path.to_owned(), inode: made? }))
    }
}

impl Drop for SocketFile {
    fn drop(&mut self) {
        let is_ours = std::fs::symlink_metadata(&self.path)
            .is_ok_and(|metadata| (metadata.dev(), metadata.ino()) == self.inode);
        if is_ours {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// True if a process listens on the socket at `path`, even one that accepts nobody and whose queue is full.
/// Does not block.
pub fn is_served(path: &Path) -> bool {
    let connected = SocketAddrUnix::new(path).and_then(|address| {
        let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
        let socket = socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None)?;
        connect(&socket, &address)
    });
    matches!(connected, Ok(()) | Err(Errno::AGAIN))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::net::UnixStream;
    use std::time::{Duration, Instant};

    fn listen(path: &Path, mode: u32) -> (UnixListener, SocketFile) {
        SocketFile::listen(path, mode, |_| Ok::<_, io::Error>(())).unwrap()
    }

    #[test]
    fn a_socket_has_its_permissions_from_the_beginning() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("frames");
        let mode = |path: &Path| std::fs::metadata(path).unwrap().mode() & 0o777;
        let looked = SocketFile::listen(&path, 0o640, |new| {
            assert!(!path.exists() && new.exists());
            Ok::<_, io::Error>(())
        });
        let (_listener, file) = looked.unwrap();
        assert_eq!(mode(&path), 0o640);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        drop(file);
        assert!(!path.exists());
        let refused = SocketFile::listen(&path, 0o600, |_| Err(io::Error::other("no such group")));
        assert!(refused.is_err() && std::fs::read_dir(folder.path()).unwrap().count() == 0);
    }

    #[test]
    fn the_end_of_one_leaves_the_socket_of_its_successor() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("local");
        let (first, second) = (listen(&path, 0o600), listen(&path, 0o600));
        drop(first);
        assert!(path.exists() && is_served(&path));
        drop(second);
        assert!(!path.exists());
    }

    #[test]
    fn a_listener_that_accepts_nobody_is_found_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("local");
        assert!(!is_served(&path));
        let (listener, _file) = listen(&path, 0o600);
        rustix::net::listen(&listener, 0).unwrap();
        // One that waits fills the queue: a connection that blocks would wait for it.
        let _waiting = UnixStream::connect(&path).unwrap();
        let begun = Instant::now();
        assert!(is_served(&path));
        assert!(begun.elapsed() < Duration::from_millis(500));
        drop(listener);
        assert!(!is_served(&path), "nobody listens any more");
    }
}
