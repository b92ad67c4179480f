//! The socket's file: made with its permissions, taken away at the end; and who may command through it.

use super::LocalError;
use super::reader::Rights;
use plumbline_config::options::LocalConfig;
use rustix::net::sockopt::socket_peercred;
use rustix::process::{Gid, geteuid};
use std::fs::Permissions;
use std::io;
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _, PermissionsExt as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

/// Permission of others to write, without which they cannot connect.
const OTHERS_CONNECT: u32 = 0o002;

/// The listening socket.
#[derive(Debug)]
pub struct Door {
    pub listener: UnixListener,
    path: PathBuf,
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
        let refused = |key, source| LocalError::Socket { path: path.clone(), key, source };
        let mode = config.mode_bits().unwrap_or(0o660);
        refuse_others(&path)?;
        // Nobody connects before the permissions are set: made under another name, it takes its place whole.
        let new = path.with_file_name(format!(
            "{}.new",
            path.file_name().map(|name| name.to_string_lossy()).unwrap_or_default()
        ));
        let _ = std::fs::remove_file(&new);
        let listener = UnixListener::bind(&new).map_err(|error| refused("local.path", error))?;
        if !config.group.is_empty() {
            let group = group_number(&config.group).map_err(|error| refused("local.group", error))?;
            rustix::fs::chown(&new, None, Some(Gid::from_raw(group)))
                .map_err(|error| refused("local.group", error.into()))?;
        }
        std::fs::set_permissions(&new, Permissions::from_mode(mode))
            .map_err(|error| refused("local.mode", error))?;
        let group = std::fs::symlink_metadata(&new).map_err(|error| refused("local.path", error))?.gid();
        std::fs::rename(&new, &path).map_err(|error| refused("local.path", error))?;
        listener.set_nonblocking(true).map_err(|error| refused("local.path", error))?;
        Ok(Self { listener, path, group, is_open_to_others: mode & OTHERS_CONNECT != 0 })
    }

    /// Rights of a reader that has connected.
    pub fn rights(&self, stream: &UnixStream) -> Rights {
        let Ok(peer) = socket_peercred(stream) else { return Rights::Read };
        let (user, group) = (peer.uid.as_raw(), peer.gid.as_raw());
        let is_ours = user == 0 || user == geteuid().as_raw() || group == self.group;
        // Where others cannot connect, the file's permissions have let in a member of the group, whose primary group may be
        // another.
        if is_ours || !self.is_open_to_others { Rights::Command(user) } else { Rights::Read }
    }
}

impl Drop for Door {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Refuses a path where something else is; a socket that nobody listens on is left over, and is replaced.
fn refuse_others(path: &Path) -> Result<(), LocalError> {
    let Ok(found) = std::fs::symlink_metadata(path) else { return Ok(()) };
    let path = path.to_owned();
    if !found.file_type().is_socket() {
        return Err(LocalError::NoSocket { path });
    }
    if UnixStream::connect(&path).is_ok() {
        return Err(LocalError::InUse { path });
    }
    Ok(())
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
        assert!(door.rights(&ours).may_command());
        drop(door);
        assert!(!path.exists());
    }

    #[test]
    fn a_path_in_use_is_refused_and_a_socket_left_over_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("local");
        let first = Door::open(&config(&path)).unwrap();
        assert!(matches!(Door::open(&config(&path)), Err(LocalError::InUse { .. })));
        drop(first);
        drop(UnixListener::bind(&path).unwrap());
        drop(Door::open(&config(&path)).unwrap());
        std::fs::write(&path, "notes").unwrap();
        assert!(matches!(Door::open(&config(&path)), Err(LocalError::NoSocket { .. })));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "notes");
    }

    #[test]
    fn a_group_is_found_by_name_and_number() {
        assert_eq!(group_number("root").unwrap(), 0);
        assert_eq!(group_number("1234").unwrap(), 1234);
        assert!(group_number("no-such-group-here").is_err());
    }
}
