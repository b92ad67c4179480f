//! Control groups of the kernel, to slow a process down or to hold a single thread still. Version 1 and, for
//! quotas, version 2; without the right to make one the tests say so.

use std::path::{Path, PathBuf};

/// A group that is removed when it goes out of scope.
pub struct Group(PathBuf);

impl Group {
    /// A group of `controller` (version 1), or of the unified tree.
    fn new(controller: &str, name: &str) -> Option<Self> {
        let name = format!("plumbline-{name}-{}", std::process::id());
        for parent in [Path::new("/sys/fs/cgroup").join(controller), PathBuf::from("/sys/fs/cgroup")] {
            let folder = parent.join(&name);
            if parent.join("cgroup.procs").exists() && std::fs::create_dir(&folder).is_ok() {
                return Some(Self(folder));
            }
        }
        println!("skipped: no control group of '{controller}' can be made here");
        None
    }

    /// A group whose processes together get `share` of one processor, in slices of 5 ms.
    pub fn with_quota(name: &str, share: f64) -> Option<Self> {
        let group = Self::new("cpu", name)?;
        let (period_us, quota_us) = (5000, (5000.0 * share) as u32);
        let set = group
            .write("cpu.cfs_period_us", &period_us.to_string())
            .and_then(|()| group.write("cpu.cfs_quota_us", &quota_us.to_string()))
            .or_else(|_| group.write("cpu.max", &format!("{quota_us} {period_us}")));
        if set.is_err() {
            println!("skipped: the quota of a control group cannot be set here");
        }
        set.is_ok().then_some(group)
    }

    /// A group that can be frozen (version 1: it takes single threads).
    pub fn freezer(name: &str) -> Option<Self> {
        Self::new("freezer", name).filter(|group| {
            let is_freezer = group.0.join("freezer.state").exists();
            if !is_freezer {
                println!("skipped: single threads cannot be frozen here");
            }
            is_freezer
        })
    }

    fn write(&self, file: &str, text: &str) -> std::io::Result<()> {
        std::fs::write(self.0.join(file), text)
    }

    /// Puts a whole process into the group.
    pub fn add_process(&self, pid: u32) {
        self.write("cgroup.procs", &pid.to_string()).unwrap();
    }

    /// Puts one thread into the group.
    pub fn add_thread(&self, tid: u32) {
        self.write("tasks", &tid.to_string()).unwrap();
    }

    /// Holds what is in the group still, or lets it go on.
    pub fn set_frozen(&self, frozen: bool) {
        self.write("freezer.state", if frozen { "FROZEN" } else { "THAWED" }).unwrap();
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        // What is frozen could not end.
        let _ = self.write("freezer.state", "THAWED");
        // A group can only go when its processes are gone.
        for _ in 0..50 {
            if std::fs::remove_dir(&self.0).is_ok() {
                return;
            }
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
    }
}
