//! The ground station's page in a real browser, with a real vehicle that comes, is reset, dies and comes back.

use super::python::interpreter;
use super::vehicle::{PLUMBLINE, Running, cache, eventually, flight, free_port, render};
use plumbline_test_support::{Need, skip};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

/// Chromium, told what to do by `tests/python/browser.py`.
struct Browser {
    child: Child,
    /// Ends the browser when it is closed.
    orders: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
}

impl Browser {
    /// `None` where there is no browser; the test says so.
    fn start() -> Option<Self> {
        if !Path::new("/usr/bin/chromium").exists() || !Path::new("/usr/bin/chromedriver").exists() {
            skip(
                Need::Chromium,
                "/usr/bin/chromium or chromedriver is missing (scripts/setup test installs them)",
            );
            return None;
        }
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/python/browser.py");
        let mut child = Command::new(interpreter("selenium")?)
            .arg(script)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (orders, answers) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        let mut browser = Self { child, orders: Some(orders), answers: BufReader::new(answers) };
        assert_eq!(browser.answer().unwrap(), "ready");
        Some(browser)
    }

    fn answer(&mut self) -> Result<Value, String> {
        let mut line = String::new();
        self.answers.read_line(&mut line).unwrap();
        let answer: Value =
            serde_json::from_str(&line).unwrap_or_else(|_| panic!("the browser said {line:?}"));
        match answer["error"].as_str() {
            Some(error) => Err(error.to_owned()),
            None => Ok(answer["value"].clone()),
        }
    }

    fn order(&mut self, order: &Value) -> Result<Value, String> {
        writeln!(self.orders.as_mut().unwrap(), "{order}").unwrap();
        self.answer()
    }

    fn attribute(&mut self, css: &str, name: &str) -> String {
        let answer = self.order(&json!({"do": "attr", "css": css, "name": name}));
        answer.ok().and_then(|value| value.as_str().map(str::to_owned)).unwrap_or_default()
    }

    fn text(&mut self, css: &str) -> String {
        let answer = self.order(&json!({"do": "text", "css": css}));
        answer.ok().and_then(|value| value.as_str().map(str::to_owned)).unwrap_or_default()
    }

    fn click(&mut self, css: &str) {
        self.order(&json!({"do": "click", "css": css})).unwrap();
    }

    /// Keeps a picture of the page beside the other artefacts of the build.
    fn screenshot(&mut self, name: &str) {
        let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        self.order(&json!({"do": "shot", "file": file})).unwrap();
        println!("screenshot: {}", file.display());
    }

    /// Keeps pictures of the page on a desk and on a phone.
    fn screenshots(&mut self, name: &str) {
        for (width, height) in [(1440, 900), (390, 844)] {
            let size = json!({"do": "size", "width": width, "height": height, "touch": width < 500});
            self.order(&size).unwrap();
            // The canvas follows with the next picture.
            std::thread::sleep(Duration::from_millis(700));
            self.screenshot(&format!("{name}-{width}.png"));
        }
        self.order(&json!({"do": "size", "width": 1440, "height": 900})).unwrap();
    }

    /// A number that the 3-D view says of what it draws.
    fn drawn(&mut self, what: &str) -> u32 {
        self.attribute("#view3d", &format!("data-{what}")).parse().unwrap_or(0)
    }

    fn presence(&mut self) -> String {
        self.attribute("[data-vehicle=\"drone\"]", "data-presence")
    }

    /// Points of the path that is drawn.
    fn points(&mut self) -> u32 {
        self.drawn("points")
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // The script takes driver and browser with it.
        drop(self.orders.take());
        let end = Instant::now() + Duration::from_secs(10);
        while matches!(self.child.try_wait(), Ok(None)) && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(50));
        }
        let _ = self.child.kill();
    }
}

/// Modules of the page without a browser: formats, geometry, the protocol, its store.
#[test]
fn modules_of_the_page_pass_their_own_tests() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../ground/web/tests");
    let mut files: Vec<PathBuf> = folder.read_dir().unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(!files.is_empty());
    let output = match Command::new("node").arg("--test").args(files).output() {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            skip(Need::Node, "there is no `node` (scripts/setup test installs it)");
            return;
        }
        output => output.unwrap(),
    };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
}

/// Roll and pitch of the vehicle, not of its IMU, whose x points up: a gentle flight stays near level.
fn check_attitude(browser: &mut Browser) {
    for field in ["roll", "pitch"] {
        let text = browser.text(&format!("[data-field=\"{field}\"]"));
        let degrees: f64 = text.parse().unwrap_or_else(|_| panic!("{field} is {text:?}"));
        assert!(degrees.abs() < 25.0, "{field} {degrees}");
    }
    assert_eq!(browser.attribute("#horizon", "data-known"), "true");
}

/// Share of the window that the 3-D view has, pairs of panels and controls that overlap, figures that are cut off, labels
/// that are not in the middle of their buttons, and by how many pixels the page is too wide.
const LAYOUT: &str = r#"
    const view = document.getElementById('view3d').getBoundingClientRect();
    const boxes = [...document.querySelectorAll('.top > *, .panel, .readouts > div, .tools > *')]
      .filter((e) => e.checkVisibility()).map((e) => [e, e.getBoundingClientRect()]);
    const name = (e) => e.id || e.className || e.tagName;
    const overlaps = [];
    for (const [i, [a, p]] of boxes.entries()) {
      for (const [b, q] of boxes.slice(i + 1)) {
        if (a.contains(b) || b.contains(a)) continue;
        const width = Math.min(p.right, q.right) - Math.max(p.left, q.left);
        const height = Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top);
        if (width > 1 && height > 1) overlaps.push(`${name(a)} ${name(b)}`);
      }
    }
    const cut = [...document.querySelectorAll('.facts dd, .readouts dd, .entry .state')]
      .filter((e) => e.checkVisibility() && e.scrollWidth > e.clientWidth + 1).map((e) => e.parentElement.textContent);
    const high = [...document.querySelectorAll('.segments span')].filter((e) => e.checkVisibility()).filter((e) => {
      const range = document.createRange();
      range.selectNodeContents(e);
      const [text, box] = [range.getBoundingClientRect(), e.getBoundingClientRect()];
      return Math.abs(text.top + text.bottom - box.top - box.bottom) > 3;
    }).map((e) => e.textContent);
    const share = (view.width * view.height) / (innerWidth * innerHeight);
    return { share, overlaps, cut, high, excess: document.documentElement.scrollWidth - innerWidth };
"#;

fn check_layout(browser: &mut Browser) {
    for (width, height, least_share) in
        [(1440, 900, 0.55), (1920, 1080, 0.55), (1280, 720, 0.45), (390, 844, 0.0)]
    {
        browser
            .order(&json!({"do": "size", "width": width, "height": height, "touch": width < 500}))
            .unwrap();
        // The canvas follows with the next picture.
        std::thread::sleep(Duration::from_millis(500));
        let layout = browser.order(&json!({"do": "script", "js": LAYOUT})).unwrap();
        let share = layout["share"].as_f64().unwrap();
        println!("{width}x{height}: the 3-D view has {:.1} % of the page", 100.0 * share);
        assert!(share >= least_share, "{width}x{height}: {layout}");
        for what in ["overlaps", "cut", "high"] {
            assert_eq!(layout[what], json!([]), "{width}x{height}: {layout}");
        }
        assert!(layout["excess"].as_f64().unwrap() <= 0.0, "{width}x{height}: {layout}");
    }
    browser.order(&json!({"do": "size", "width": 1440, "height": 900})).unwrap();
}

/// Bytes that no page would send, at the web socket and beside it.
#[test]
fn network_page_survives_noise_at_its_socket() {
    use std::io::Read;
    use std::net::TcpStream;
    let port = free_port();
    let mut command = Command::new(PLUMBLINE);
    let page = format!("127.0.0.1:{port}");
    let listen = format!("tcp/127.0.0.1:{}", free_port());
    command.args(["ground", "--plain", "--listen", &listen, "--http", &page]);
    let mut station = Running::start(command);
    eventually("the page is served", Duration::from_secs(10), || TcpStream::connect(&page).is_ok());
    let ask = |request: &str, body: &[u8]| {
        let mut stream = TcpStream::connect(&page).unwrap();
        stream.set_read_timeout(Some(Duration::from_millis(300))).unwrap();
        let _ = stream.write_all(request.as_bytes());
        let _ = stream.write_all(body);
        let mut answer = vec![0; 512];
        let count = stream.read(&mut answer).unwrap_or(0);
        String::from_utf8_lossy(&answer[..count]).into_owned()
    };
    let upgrade = format!(
        "GET /ws HTTP/1.1\r\nHost: {page}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
    );
    let mut noise = 7u64;
    for round in 0..30usize {
        let bytes: Vec<u8> = (0..[2, 20, 200, 9_000][round % 4])
            .map(|_| {
                noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (noise >> 56) as u8
            })
            .collect();
        assert!(ask(&upgrade, &bytes).contains("101"), "the socket no longer opens");
        ask("", &bytes);
    }
    // A masked text frame that is JSON, and none that is known.
    let text = br#"{"type":"launch"}"#;
    let frame = [&[0x81, 0x80 | text.len() as u8, 0, 0, 0, 0][..], text].concat();
    ask(&upgrade, &frame);
    let from_elsewhere = upgrade.replace("\r\n\r\n", "\r\nOrigin: http://evil.example\r\n\r\n");
    assert!(ask(&from_elsewhere, &[]).contains("403"));
    assert!(ask(&upgrade.replace(&page, "evil.example"), &[]).contains("403"));
    let body = r#"{"kind":"hard"}"#;
    let reset = format!(
        "POST /api/vehicles/drone/reset HTTP/1.1\r\nHost: {page}\r\nContent-Type: text/plain\r\n\
         Content-Length: {}\r\n\r\n{body}",
        body.len()
    );
    assert!(ask(&reset, &[]).contains("403"), "a form of another page could reset");
    assert!(ask(&reset.replace("text/plain", "application/json"), &[]).contains("404"));
    assert!(ask(&format!("GET /../Cargo.toml HTTP/1.1\r\nHost: {page}\r\n\r\n"), &[]).contains("404"));
    // It is still there, and has counted.
    let mut socket = TcpStream::connect(&page).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(2))).unwrap();
    socket.write_all(upgrade.as_bytes()).unwrap();
    let mut heard = String::new();
    eventually("the fleet is told", Duration::from_secs(5), || {
        let mut bytes = [0; 4_096];
        let count = socket.read(&mut bytes).unwrap_or(0);
        heard.push_str(&String::from_utf8_lossy(&bytes[..count]));
        heard.contains("\"malformed\":")
    });
    let counted: u64 = heard
        .split("\"malformed\":")
        .nth(1)
        .and_then(|rest| rest.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok())
        .unwrap();
    assert!(counted >= 10, "{counted} counted");
    assert!(station.child.try_wait().unwrap().is_none(), "{}", station.words());
}

/// Tests that measure rates and times: see `.config/nextest.toml`.
mod realtime {
    use super::*;

    #[test]
    fn network_page_shows_loops_and_the_corrected_path_to_those_who_come_late_too() {
        const PATIENCE: Duration = Duration::from_secs(20);
        // Two rounds of the same way take half a minute, the second begins after fourteen seconds.
        const SECOND_ROUND: Duration = Duration::from_secs(60);
        let laps = |more: &[&str]| {
            let mut command = Command::new(PLUMBLINE);
            command.args("replay sim:room --laps 2 --duration 12 --scale 0.4 --no-lines".split(' '));
            command.arg("--cache").arg(cache()).args(more);
            command
        };
        crate::done(laps(&[]));
        let Some(mut browser) = Browser::start() else { return };
        let endpoint = format!("tcp/127.0.0.1:{}", free_port());
        let station = || {
            let page = format!("127.0.0.1:{}", free_port());
            let mut command = Command::new(PLUMBLINE);
            command.args(["ground", "--plain", "--connect", &endpoint, "--http", &page]);
            (Running::start(command), format!("http://{page}/"))
        };
        let (_first, url) = station();
        eventually("the page is served", PATIENCE, || {
            browser.order(&json!({"do": "open", "url": url})).is_ok()
        });
        let mut vehicle = Running::start(laps(&["--speed", "1", "--publish", "--listen", &endpoint]));
        eventually("the place in the map is known", PATIENCE, || {
            browser.text("#map-note").contains("no place seen again yet")
        });
        eventually("the corrected path grows", PATIENCE, || browser.drawn("corrected") > 5);
        eventually("a loop is drawn", SECOND_ROUND, || browser.drawn("loops") > 0);
        let (_second, url) = station();
        eventually("the page of one who comes late is served", PATIENCE, || {
            browser.order(&json!({"do": "open", "url": url})).is_ok()
        });
        eventually("it shows the loops of before", PATIENCE, || browser.drawn("loops") > 0);
        eventually("and told of", PATIENCE, || {
            let words = browser.text("#map-note");
            words.contains("drift taken out") && !words.contains(" 0 loops")
        });
        println!("{}", browser.text("#map-note"));
        let _ = browser
            .order(&json!({"do": "script", "js": "document.querySelector('input[value=map]').click()"}));
        eventually("the map frame is shown", PATIENCE, || {
            browser.text("#frame-note").starts_with("map frame M: 0.")
        });
        browser.screenshot("ground-map.png");
        assert_eq!(browser.order(&json!({"do": "errors"})).unwrap(), json!([]), "the console of the page");
        vehicle.interrupt();
    }

    #[test]
    fn network_page_shows_a_vehicle_that_comes_is_reset_dies_and_comes_back() {
        const PATIENCE: Duration = Duration::from_secs(20);
        // Longer than a browser takes that draws without a graphics card.
        const FLIGHT_S: u32 = 90;
        render(FLIGHT_S);
        let Some(mut browser) = Browser::start() else { return };
        let (vehicle_port, page_port) = (free_port(), free_port());
        let endpoint = format!("tcp/127.0.0.1:{vehicle_port}");
        let mut command = Command::new(PLUMBLINE);
        let page = format!("127.0.0.1:{page_port}");
        command.args(["ground", "--plain", "--connect", &endpoint, "--http", &page]);
        let station = Running::start(command);
        let folder = tempfile::tempdir().unwrap();
        let report = folder.path().join("report.json");
        let fly = || {
            let mut command = flight("drone", FLIGHT_S);
            command.args(["--listen", &endpoint, "--report"]).arg(&report);
            Running::start(command)
        };
        let url = format!("http://{page}/");
        eventually("the page is served", PATIENCE, || {
            browser.order(&json!({"do": "open", "url": url})).is_ok()
        });
        eventually("the socket is open, and nobody there", PATIENCE, || {
            browser.attribute("#connection", "data-state") == "waiting"
        });
        let tried = format!("Connecting to {endpoint}");
        for place in ["#waiting", "#fleet-empty"] {
            eventually("it is said what is tried", PATIENCE, || browser.text(place).contains(&tried));
        }
        assert_eq!(browser.text("#connection-text"), "No vehicle");
        browser.screenshots("ground-waiting");

        let mut vehicle = fly();
        eventually("the vehicle is tracking", PATIENCE, || browser.presence() == "tracking");
        eventually("its path grows", PATIENCE, || browser.points() > 20);
        let before = browser.points();
        eventually("and goes on growing", PATIENCE, || browser.points() > before + 20);
        let position = browser.text("#position");
        eventually("its position changes", PATIENCE, || browser.text("#position") != position);
        eventually("its camera is seen", PATIENCE, || !browser.attribute("#camera", "data-stamp").is_empty());
        check_attitude(&mut browser);
        assert_eq!(browser.attribute("#connection", "data-state"), "open");
        assert!(browser.text("#legend").contains("landmarks of the map"), "{}", browser.text("#legend"));
        check_layout(&mut browser);
        browser.screenshot("ground-light.png");

        assert_eq!(browser.text("#resets").trim(), "0");
        browser.click("#reset-soft");
        eventually("the question is asked", PATIENCE, || !browser.text("#confirm-yes").is_empty());
        browser.click("#confirm-yes");
        eventually("the reset was done", PATIENCE, || browser.text("#resets").trim() == "1");
        eventually("the event is told", PATIENCE, || browser.text("#events").contains("reset"));
        eventually("it tracks again", PATIENCE, || browser.presence() == "tracking");

        eventually("its map grows", PATIENCE, || browser.drawn("keyframes") > 5);
        browser.screenshots("ground-before-reset");
        let landmarks = browser.drawn("landmarks");
        browser.click("#reset-hard");
        eventually("the question is asked", PATIENCE, || !browser.text("#confirm-yes").is_empty());
        browser.click("#confirm-yes");
        eventually("the reset was done", PATIENCE, || browser.text("#resets").trim() == "2");
        eventually("the old odometry frame is gone", PATIENCE, || {
            browser.drawn("keyframes") == 0 && browser.drawn("landmarks") < landmarks / 4
        });
        eventually("a map of the new one grows", PATIENCE, || browser.drawn("keyframes") > 1);
        browser.screenshots("ground-after-reset");

        vehicle.kill();
        let killed = Instant::now();
        eventually("it is lost within two seconds", Duration::from_secs(2), || browser.presence() == "lost");
        println!("lost after {:.2} s", killed.elapsed().as_secs_f64());
        let mut vehicle = fly();
        eventually("it comes back", PATIENCE, || browser.presence() == "tracking");
        let stamp = browser.attribute("#camera", "data-stamp");
        eventually("its camera is seen again", PATIENCE, || {
            browser.attribute("#camera", "data-stamp") != stamp
        });
        std::thread::sleep(Duration::from_secs(3));
        browser.click("#theme");
        browser.screenshot("ground-other-theme.png");
        let errors = browser.order(&json!({"do": "errors"})).unwrap();
        assert_eq!(errors, json!([]), "the console of the page");
        vehicle.interrupt();
        let report = crate::json(report);
        assert_eq!(
            report["hot_path_allocations"], 0,
            "while it published, and somebody looked at its camera"
        );
        assert!(!station.words().contains("panicked"), "{}", station.words());
    }
}
