//! Control groups of the kernel, to slow a process down or to hold a single thread still: version 1, version 2, or both
//! side by side as many systems mount them. Where a group cannot be made the tests say so.

use plumbline_test_support::{Need, skip};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The slice of time that a quota is of, us: not that of the samples, which would all wait or none. The kernel refuses less
/// than a millisecond of it.
const PERIOD_US: u32 = 4000;
/// In a version 2 group: the threads of its processes that are to be held still.
const THREADS: &str = "threads";

/// Version of a hierarchy's interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Version {
    One,
    Two,
}

/// A group that is removed when it goes out of scope.
pub struct Group {
    folder: PathBuf,
    version: Version,
}

impl Group {
    /// A group whose processes together get `share` of one processor, in slices of 4 ms.
    pub fn with_quota(name: &str, share: f64) -> Option<Self> {
        let quota_us = (f64::from(PERIOD_US) * share) as u32;
        let set = |group: Self| -> io::Result<Self> {
            match group.version {
                Version::One => {
                    group.write("cpu.cfs_period_us", &PERIOD_US.to_string())?;
                    group.write("cpu.cfs_quota_us", &quota_us.to_string())?;
                }
                Version::Two => group.write("cpu.max", &format!("{quota_us} {PERIOD_US}"))?,
            }
            Ok(group)
        };
        Self::first_of(Need::CgroupQuota, hierarchies("cpu"), |hierarchy| {
            set(Self::new(&hierarchy, "cpu", name)?)
        })
    }

    /// A group of which single threads can be held still.
    pub fn freezer(name: &str) -> Option<Self> {
        Self::first_of(Need::CgroupFreezer, hierarchies("freezer"), |hierarchy| {
            Self::freezer_in(&hierarchy, name)
        })
    }

    fn freezer_in(hierarchy: &Hierarchy, name: &str) -> io::Result<Self> {
        let group = Self::new(hierarchy, "freezer", name)?;
        match group.version {
            Version::One => group.write("freezer.state", "THAWED")?,
            Version::Two => {
                // A thread can leave its process only for a threaded group below that of the process.
                std::fs::create_dir(group.folder.join(THREADS))?;
                group.write(&format!("{THREADS}/cgroup.type"), "threaded")?;
                group.write(&format!("{THREADS}/cgroup.freeze"), "0")?;
            }
        }
        Ok(group)
    }

    /// Group in the first of the hierarchies that permits it; otherwise the test skips itself.
    fn first_of(
        need: Need,
        hierarchies: Vec<Hierarchy>,
        make: impl Fn(Hierarchy) -> io::Result<Self>,
    ) -> Option<Self> {
        let mut reasons = String::new();
        for hierarchy in hierarchies {
            let folder = hierarchy.folder.display().to_string();
            match make(hierarchy) {
                Ok(group) => return Some(group),
                Err(error) => reasons += &format!("; {folder}: {error}"),
            }
        }
        skip(need, format_args!("no such group can be made{reasons}"));
        None
    }

    fn new(hierarchy: &Hierarchy, controller: &str, name: &str) -> io::Result<Self> {
        // Frozen groups of version 2 need no controller.
        if hierarchy.version == Version::Two && controller != "freezer" {
            std::fs::write(hierarchy.folder.join("cgroup.subtree_control"), format!("+{controller}"))?;
        }
        let folder = hierarchy.folder.join(format!("plumbline-{name}-{}", std::process::id()));
        std::fs::create_dir(&folder)?;
        Ok(Self { folder, version: hierarchy.version })
    }

    fn write(&self, file: &str, text: &str) -> io::Result<()> {
        std::fs::write(self.folder.join(file), text)
    }

    /// Puts a whole process into the group.
    pub fn add_process(&self, pid: u32) {
        self.write("cgroup.procs", &pid.to_string()).unwrap();
    }

    /// Puts the thread `tid` of the process `pid` where it can be held still.
    pub fn add_thread(&self, pid: u32, tid: u32) {
        match self.version {
            Version::One => self.write("tasks", &tid.to_string()).unwrap(),
            Version::Two => {
                self.add_process(pid);
                self.write(&format!("{THREADS}/cgroup.threads"), &tid.to_string()).unwrap();
            }
        }
    }

    /// Holds the threads that were added still, or lets them go on.
    pub fn set_frozen(&self, frozen: bool) {
        self.try_set_frozen(frozen).unwrap();
    }

    fn try_set_frozen(&self, frozen: bool) -> io::Result<()> {
        match self.version {
            Version::One => self.write("freezer.state", if frozen { "FROZEN" } else { "THAWED" }),
            Version::Two => self.write(&format!("{THREADS}/cgroup.freeze"), if frozen { "1" } else { "0" }),
        }
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        // What is frozen could not end. A group with a quota has nothing to thaw.
        let _ = self.try_set_frozen(false);
        // A group can only go when its processes are gone.
        for _ in 0..50 {
            let _ = std::fs::remove_dir(self.folder.join(THREADS));
            if std::fs::remove_dir(&self.folder).is_ok() {
                return;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

/// A mounted tree of groups.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Hierarchy {
    folder: PathBuf,
    version: Version,
}

/// The mounted trees that may have `controller`, version 1 first: where both are mounted, that one has it.
fn hierarchies(controller: &str) -> Vec<Hierarchy> {
    hierarchies_in(&std::fs::read_to_string("/proc/self/mounts").unwrap_or_default(), controller)
}

fn hierarchies_in(mounts: &str, controller: &str) -> Vec<Hierarchy> {
    let hierarchy = |line: &str| {
        let [_, folder, kind, options] = line.split(' ').take(4).collect::<Vec<_>>().try_into().ok()?;
        let version = match kind {
            "cgroup" if options.split(',').any(|option| option == controller) => Version::One,
            "cgroup2" => Version::Two,
            _ => return None,
        };
        Some(Hierarchy { folder: Path::new(folder).to_owned(), version })
    };
    let mut found: Vec<Hierarchy> = mounts.lines().filter_map(hierarchy).collect();
    found.sort_by_key(|hierarchy| hierarchy.version == Version::Two);
    found
}

#[test]
fn cgroup_trees_of_both_versions_are_found() {
    let mounts = "tmpfs /sys/fs/cgroup tmpfs rw 0 0\n\
                  cgroup2 /sys/fs/cgroup/unified cgroup2 rw,relatime 0 0\n\
                  cgroup /sys/fs/cgroup/cpu cgroup rw,relatime,cpu,cpuacct 0 0\n\
                  cgroup /sys/fs/cgroup/cpuset cgroup rw,relatime,cpuset 0 0\n";
    let tree = |folder: &str, version| Hierarchy { folder: folder.into(), version };
    assert_eq!(
        hierarchies_in(mounts, "cpu"),
        [tree("/sys/fs/cgroup/cpu", Version::One), tree("/sys/fs/cgroup/unified", Version::Two)]
    );
    let alone = "cgroup2 /sys/fs/cgroup cgroup2 rw,nosuid 0 0\n";
    assert_eq!(hierarchies_in(alone, "freezer"), [tree("/sys/fs/cgroup", Version::Two)]);
}

/// A shell that counts for ever, and how far it came: ended with the test.
struct Counting(std::process::Child);

impl Counting {
    fn start() -> Self {
        Self(std::process::Command::new("sh").args(["-c", "while :; do :; done"]).spawn().unwrap())
    }

    /// Processor time so far, ticks of 10 ms.
    fn ticks(&self) -> u64 {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.0.id())).unwrap();
        let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
        fields[11].parse::<u64>().unwrap() + fields[12].parse::<u64>().unwrap()
    }

    fn ticks_within(&self, time: Duration) -> u64 {
        let before = self.ticks();
        std::thread::sleep(time);
        self.ticks() - before
    }
}

impl Drop for Counting {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Makes a freezer in every tree of a version, holds a thread still in it, and lets it go.
fn holds_a_thread_still(need: Need, version: Version) {
    let trees: Vec<Hierarchy> = hierarchies("freezer").into_iter().filter(|t| t.version == version).collect();
    let make = |tree: Hierarchy| Group::freezer_in(&tree, "hold");
    let Some(group) = Group::first_of(need, trees, make) else { return };
    let counting = Counting::start();
    group.add_thread(counting.0.id(), counting.0.id());
    group.set_frozen(true);
    // It stops when it next comes by the kernel.
    std::thread::sleep(Duration::from_millis(100));
    assert_eq!(counting.ticks_within(Duration::from_millis(300)), 0, "{version:?} does not hold it still");
    group.set_frozen(false);
    let patience = std::time::Instant::now() + Duration::from_secs(10);
    while counting.ticks_within(Duration::from_millis(100)) == 0 {
        assert!(std::time::Instant::now() < patience, "{version:?} does not let it go");
    }
    drop(counting);
    let folder = group.folder.clone();
    drop(group);
    assert!(!folder.exists(), "{} is left behind", folder.display());
}

#[test]
fn cgroup_freezer_of_version_one_holds_a_thread_still() {
    // A host that has version 2 alone lacks nothing.
    if hierarchies("freezer").iter().any(|tree| tree.version == Version::One) {
        holds_a_thread_still(Need::CgroupFreezer, Version::One);
    }
}

#[test]
fn cgroup_freezer_of_version_two_holds_a_thread_still() {
    holds_a_thread_still(Need::CgroupV2, Version::Two);
}
