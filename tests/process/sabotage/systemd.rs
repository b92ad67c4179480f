//! Our unit file under a real systemd: the one of this host, booted a second time in namespaces of its own
//! (`tests/systemd/boot`). No sensor is there, which keeps nobody from starting. Part of `make soak`.

use crate::plumbline;
use plumbline_test_support::{Need, skip, workspace};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const NAMESPACES: [&str; 7] = ["--mount", "--pid", "--fork", "--kill-child", "--cgroup", "--uts", "--ipc"];
/// More starts than systemd allows in ten seconds where a unit does not say otherwise.
const KILLS: u32 = 8;

/// A systemd of its own, gone with the test.
struct Systemd {
    child: Child,
    folder: tempfile::TempDir,
    /// Process ID of systemd, on this side.
    pid: String,
}

impl Systemd {
    /// Booted with our unit, and this beside it.
    fn boot(more_of_the_unit: &str) -> Option<Self> {
        let can = Command::new("unshare").args(NAMESPACES).arg("true").output();
        if !can.is_ok_and(|done| done.status.success()) || !Path::new("/lib/systemd/systemd").exists() {
            skip(Need::Systemd, "there is no systemd here, or no right to make namespaces");
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let unit = std::fs::read_to_string(workspace().join("runtime/systemd/plumbline.service")).unwrap();
        std::fs::write(
            at("plumbline.service"),
            unit.replace("[Install]", &format!("{more_of_the_unit}\n[Install]")),
        )
        .unwrap();
        let preset = String::from_utf8(plumbline(&["config", "sim"]).stdout).unwrap();
        let sensor = "connect = \"serial:///run/plumbline/imu:921600\"";
        let (before, imu) = preset.split_once("[driver.imu]").unwrap();
        let config = format!("{before}[driver.imu]{}", imu.replacen("connect = \"\"", sensor, 1)).replacen(
            "listen = \"\"\n",
            "listen = \"/run/plumbline/frames\"\n",
            1,
        );
        std::fs::write(at("plumbline.toml"), config).unwrap();
        std::fs::copy(env!("CARGO_BIN_EXE_plumbline"), at("plumbline")).unwrap();
        let said = std::fs::File::create(at("said")).unwrap();
        let mut command = Command::new("unshare");
        command.args(NAMESPACES).arg(workspace().join("tests/systemd/boot")).arg(folder.path());
        let child = command.stdout(Stdio::null()).stderr(said).spawn().unwrap();
        let mut systemd = Self { child, folder, pid: String::new() };
        systemd.eventually("systemd is up", |systemd| {
            let children = format!("/proc/{0}/task/{0}/children", systemd.child.id());
            let pid = std::fs::read_to_string(children).unwrap_or_default().trim().to_owned();
            let is_systemd =
                std::fs::read_to_string(format!("/proc/{pid}/comm")).is_ok_and(|c| c == "systemd\n");
            systemd.pid = pid;
            is_systemd && !systemd.run(&["systemctl", "show", "plumbline", "-p", "Id"]).is_empty()
        });
        Some(systemd)
    }

    fn eventually(&mut self, what: &str, mut is_so: impl FnMut(&mut Self) -> bool) {
        let end = Instant::now() + Duration::from_secs(20);
        while !is_so(self) {
            let said = std::fs::read_to_string(self.folder.path().join("said")).unwrap();
            assert!(
                Instant::now() < end,
                "{what}: {} {said}",
                self.run(&["systemctl", "status", "plumbline", "-l"])
            );
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Output of a command run there.
    fn run(&self, command: &[&str]) -> String {
        let entered = ["-t", &self.pid, "-m", "-p", "-C", "-u", "-i", "-r", "-w"];
        let output = Command::new("nsenter").args(entered).args(command).output().unwrap();
        String::from_utf8_lossy(&output.stdout).trim().to_owned()
    }

    /// A property of our unit.
    fn shows(&self, property: &str) -> String {
        self.run(&["systemctl", "show", "plumbline", "--value", "-p", property])
    }

    fn restarts(&self) -> u32 {
        self.shows("NRestarts").parse().unwrap_or(0)
    }

    /// Sends a signal to the process of the unit; how long it takes until another one is active, s.
    fn is_back_after(&mut self, signal: &str) -> f64 {
        let (before, began) = (self.shows("MainPID"), Instant::now());
        self.run(&["kill", signal, &before]);
        self.eventually("it is back", |systemd| {
            systemd.shows("MainPID") != before && systemd.shows("ActiveState") == "active"
        });
        began.elapsed().as_secs_f64()
    }
}

impl Drop for Systemd {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
#[ignore = "half a minute: `make soak`"]
fn soak_systemd_starts_our_unit_again_for_ever_kills_it_when_it_stands_still_and_stops_it_gracefully() {
    let Some(mut systemd) = Systemd::boot("") else { return };
    systemd.run(&["systemctl", "start", "plumbline"]);
    systemd.eventually("it is ready", |systemd| systemd.shows("ActiveState") == "active");
    // What the unit takes away from it, and what it still has: real-time priorities, and logs for its group alone.
    let status = systemd.run(&["cat", &format!("/proc/{}/status", systemd.shows("MainPID"))]);
    for line in ["CapBnd:\t0000000000000000", "NoNewPrivs:\t1", "Seccomp:\t2"] {
        assert!(status.contains(line), "{line}: {status}");
    }
    let tasks = format!("for t in /proc/{}/task/*; do chrt -p ${{t##*/}}; done", systemd.shows("MainPID"));
    systemd.eventually("it flies with real-time priorities", |systemd| {
        systemd.run(&["sh", "-c", &tasks]).contains("SCHED_FIFO")
    });
    assert_eq!(systemd.run(&["sh", "-c", "stat -c %a /var/lib/plumbline/*.mcap | sort -u"]), "640");
    let mut killed: Vec<f64> = (0..KILLS).map(|_| systemd.is_back_after("-KILL")).collect();
    killed.sort_by(f64::total_cmp);
    assert_eq!((systemd.restarts(), systemd.shows("Result").as_str()), (KILLS, "success"));
    let stopped_s = systemd.is_back_after("-STOP");
    println!(
        "back {:.2} s after a kill in the median, {stopped_s:.2} s after it stood still",
        killed[killed.len() / 2]
    );
    assert_eq!(systemd.restarts(), KILLS + 1, "the watchdog has killed it");
    // A log for each start, and resets that count on.
    let files = systemd.run(&[
        "sh",
        "-c",
        "ls /var/lib/plumbline/*.mcap | wc -l; cat /var/lib/plumbline/reset_counter",
    ]);
    assert!(files.starts_with(&format!("{}\n", KILLS + 2)), "{files}");
    let began = Instant::now();
    systemd.run(&["systemctl", "stop", "plumbline"]);
    assert_eq!([systemd.shows("ActiveState"), systemd.shows("Result")], ["inactive", "success"]);
    assert!(began.elapsed() < Duration::from_secs(4), "{:?}", began.elapsed());
    assert!(killed[killed.len() - 1] < 4.0 && stopped_s < 5.0, "{killed:?} {stopped_s}");
}

#[test]
#[ignore = "half a minute: `make soak`"]
fn soak_systemd_hears_by_the_status_that_a_task_has_died_and_starts_the_unit_again() {
    let Some(mut systemd) = Systemd::boot("Environment=PLUMBLINE_SABOTAGE=tick=panic@1") else { return };
    systemd.run(&["systemctl", "start", "plumbline"]);
    // Between the end and the next start.
    systemd.eventually("status 3", |systemd| systemd.shows("ExecMainStatus") == "3");
    systemd.eventually("it was started again twice", |systemd| systemd.restarts() >= 2);
}
