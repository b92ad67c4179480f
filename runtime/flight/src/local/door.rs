//! The socket's file: made with its permissions, taken away at the end; and who may command through it.

use super::LocalError;
use super::reader::Rights;
use plumbline_config::options::LocalConfig;
use plumbline_drivers::unix_socket::{SocketFile, is_served};
use rustix::net::sockopt::socket_peercred;
use rustix::process::{Gid, geteuid};
use std::io;
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

/// Permission of others to write, without which they cannot connect.
const OTHERS_CONNECT: u32 = 0o002;

/// The listening socket.
#[derive(Debug)]
pub struct Door {
    pub listener: UnixListener,
    _file: SocketFile,
    group: u32,
    is_open_to_others: bool,
}

impl Door {
    /// Makes the socket.
    ///
    /// # Errors
    /// When another process listens on the path, something else is there, or the file, its group or its permissions cannot
    /// be made.
    pub fn open(config: &LocalConfig) -> Result<Self, LocalError> {
        let path = PathBuf::from(&config.path);
        let mode = config.mode_bits().unwrap_or(0o660);
        refuse_others(&path)?;
        let mut group = None;
        let (listener, file) = SocketFile::listen(&path, mode, |new| {
            if !config.group.is_empty() {
                let group = group_number(&config.group).map_err(|error| Refused("local.group", error))?;
                rustix::fs::chown(new, None, Some(Gid::from_raw(group)))
                    .map_err(|error| Refused("local.group", error.into()))?;
            }
            group = Some(std::fs::symlink_metadata(new)?.gid());
            Ok::<_, Refused>(())
        })
        .and_then(|opened| opened.0.set_nonblocking(true).map(|()| opened).map_err(Refused::from))
        .map_err(|Refused(key, error)| {
            let reason = format!("the socket cannot be made: {error} ({key})");
            LocalError::Path { path: path.clone(), reason }
        })?;
        let group = group.unwrap_or_default();
        Ok(Self { listener, _file: file, group, is_open_to_others: mode & OTHERS_CONNECT != 0 })
    }

    /// Rights of a reader that has connected, and its user where the system tells it.
    pub fn rights(&self, stream: &UnixStream) -> (Rights, Option<u32>) {
        let Ok(peer) = socket_peercred(stream) else { return (Rights::Read, None) };
        let (user, group) = (peer.uid.as_raw(), peer.gid.as_raw());
        let is_ours = user == 0 || user == geteuid().as_raw() || group == self.group;
        // Where others cannot connect, the file's permissions have let in a member of the group, whose primary group may be
        // another.
        let may_command = is_ours || !self.is_open_to_others;
        (if may_command { Rights::Command(user) } else { Rights::Read }, Some(user))
    }
}

/// Key of the configuration that cannot be followed, and what the system said.
struct Refused(&'static str, io::Error);

impl From<io::Error> for Refused {
    fn from(error: io::Error) -> Self {
        Self("local.path", error)
    }
}

/// Refuses a path where something else is; a socket that nobody listens on is left over, and is replaced.
fn refuse_others(path: &Path) -> Result<(), LocalError> {
    let Ok(found) = std::fs::symlink_metadata(path) else { return Ok(()) };
    let reason = if !found.file_type().is_socket() {
        "exists and is not a socket; delete it, or set local.path to another path"
    } else if is_served(path) {
        "another process listens on it; stop it, or set local.path to another path"
    } else {
        return Ok(());
    };
    Err(LocalError::Path { path: path.to_owned(), reason: reason.into() })
}

/// Number of a group by its number or its name in `/etc/group`.
fn group_number(group: &str) -> io::Result<u32> {
    if let Ok(number) = group.parse() {
        return Ok(number);
    }
    let listed = std::fs::read_to_string("/etc/group")?;
    let number = listed.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        fields.nth(1)?.parse().ok().filter(|_| name == group)
    });
    number.ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "/etc/group has no such group"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(path: &Path) -> LocalConfig {
        LocalConfig { path: path.display().to_string(), ..LocalConfig::default() }
    }

    #[test]
    fn the_socket_has_its_permissions_and_goes_with_its_door() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("local");
        let door = Door::open(&LocalConfig { mode: "0640".into(), ..config(&path) }).unwrap();
        assert_eq!(std::fs::metadata(&path).unwrap().mode() & 0o777, 0o640);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        let (_reader, ours) = (UnixStream::connect(&path).unwrap(), door.listener.accept().unwrap().0);
        assert!(door.rights(&ours).0.may_command());
        drop(door);
        assert!(!path.exists());
    }

    #[test]
    fn a_path_in_use_is_refused_and_a_socket_left_over_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("local");
        let first = Door::open(&config(&path)).unwrap();
        assert!(Door::open(&config(&path)).err().unwrap().to_string().contains("another process listens"));
        drop(first);
        drop(UnixListener::bind(&path).unwrap());
        drop(Door::open(&config(&path)).unwrap());
        std::fs::write(&path, "notes").unwrap();
        assert!(Door::open(&config(&path)).err().unwrap().to_string().contains("is not a socket"));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "notes");
    }

    #[test]
    fn a_group_is_found_by_name_and_number() {
        assert_eq!(group_number("root").unwrap(), 0);
        assert_eq!(group_number("1234").unwrap(), 1234);
        assert!(group_number("no-such-group-here").is_err());
    }
}
