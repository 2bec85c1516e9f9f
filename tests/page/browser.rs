//! The page in headless Chromium: `chromium` on the path, or what `GSPOTENTIAL_CHROMIUM` names.

use std::path::Path;
use std::process::Command;

use super::content::HOSTILE;
use super::{PRINCIPAL, SIZE, run_with};

/// Before the page's own scripts: counts errors, has frames without a screen, and writes down what
/// was found.
const BEFORE: &str = r#"<script>
window.problems = [];
window.addEventListener("error", (e) => problems.push(String(e.message)));
console.error = (...args) => problems.push(args.join(" "));
window.requestAnimationFrame = (f) => setTimeout(() => f(performance.now()), 10);
function report(found) {
  const element = document.createElement("pre");
  element.textContent = `found:${btoa(unescape(encodeURIComponent(JSON.stringify(found))))}:found`;
  document.body.append(element);
}
</script>"#;

/// After them: moves what can be moved and writes down what came of it.
const AFTER: &str = r##"<script>
const found = { problems };
const pixels = (id) => {
  const source = document.getElementById(id);
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [source.width, source.height];
  const context = copy.getContext("2d");
  context.drawImage(source, 0, 0);
  return context.getImageData(0, 0, copy.width, copy.height).data;
};
const centre = (id) => {
  const all = pixels(id);
  const { width, height } = document.getElementById(id);
  const at = 4 * (width * Math.floor(height / 2) + Math.floor(width / 2));
  return Array.from(all.slice(at, at + 3));
};
// The middle of what is red, as shares of width and height.
const middle = (id) => {
  const all = pixels(id);
  const { width, height } = document.getElementById(id);
  let [x, y, sum] = [0, 0, 0];
  for (let i = 0; i < width * height; i++) {
    x += all[4 * i] * (i % width + 0.5) / width;
    y += all[4 * i] * (Math.floor(i / width) + 0.5) / height;
    sum += all[4 * i];
  }
  return [x / sum, y / sum];
};
setTimeout(() => {
  const compare = document.querySelector(".compare");
  const cut = () => getComputedStyle(compare.querySelectorAll("img")[1]).clipPath;
  const slider = compare.querySelector("input");
  found.cut_before = cut();
  slider.value = "80";
  slider.dispatchEvent(new Event("input"));
  found.cut_after = cut();

  found.scene_centre = centre("scene");
  found.ball = middle("scene");
  found.scene_corner = Array.from(pixels("scene").slice(0, 3));
  const globe = pixels("globe").join();
  const key = new KeyboardEvent("keydown", { key: "ArrowLeft" });
  document.getElementById("globe").dispatchEvent(key);
  found.globe_turns = globe !== pixels("globe").join();
  const map = pixels("map").join();
  const chooser = document.getElementById("field-quantity");
  chooser.value = "2";
  chooser.dispatchEvent(new Event("change"));
  found.map_changes = map !== pixels("map").join();
  found.cameras = Array.from(document.getElementById("scene-camera").options, (o) => o.text);
  found.title = document.title;

  const scene = document.getElementById("scene");
  for (let i = 0; i < 30; i++) scene.dispatchEvent(new WheelEvent("wheel", { deltaY: -100 }));
  setTimeout(() => {
    found.scene_near = Array.from(pixels("scene").slice(0, 3));
    report(found);
  }, 500);
}, 500);
</script>"##;

fn browser() -> String {
    let named = std::env::var("GSPOTENTIAL_CHROMIUM").ok();
    let known = ["chromium", "chromium-browser", "google-chrome"].map(str::to_owned);
    let answers = |name: &String| {
        let asked = Command::new(name).arg("--version").output();
        asked.is_ok_and(|output| output.status.success())
    };
    let browser = named.into_iter().chain(known).find(answers);
    browser.expect("this test needs Chromium")
}

/// Whether a page has met with no problem so far.
pub(crate) fn is_as_opened(found: &serde_json::Value) -> bool {
    found["problems"] == serde_json::json!([])
}

/// A browser without a window, with its profile in `folder`.
pub(crate) fn headless(folder: &Path) -> Command {
    let mut command = Command::new(browser());
    command
        .args(["--headless=new", "--no-sandbox", "--use-angle=swiftshader"])
        .args([
            "--enable-unsafe-swiftshader",
            "--force-prefers-reduced-motion",
            "--window-size=900,900",
        ])
        .arg(format!(
            "--user-data-dir={}",
            folder.join("profile").display()
        ));
    command
}

/// Opens `page` with `after` behind its scripts and returns what that reports.
pub(crate) fn found_in(folder: &Path, page: &str, after: &str) -> serde_json::Value {
    let probed = page.replacen("<title>", &format!("{BEFORE}<title>"), 1);
    let probed = probed.replacen("</body>", &format!("{after}</body>"), 1);
    let path = folder.join("probed.html");
    std::fs::write(&path, probed).unwrap();
    let output = headless(folder)
        .args(["--virtual-time-budget=5000", "--dump-dom"])
        .arg(format!("file://{}", path.display()))
        .output()
        .unwrap();
    let dom = String::from_utf8(output.stdout).unwrap();
    // The script has the word, too, but not as an element.
    let mark = "<pre>found:";
    let start = dom.find(mark).unwrap_or_else(|| {
        let log = String::from_utf8_lossy(&output.stderr);
        panic!("the probe wrote nothing: {log}")
    });
    let text = &dom[start + mark.len()..];
    let text = &text[..text.find(":found").unwrap()];
    use base64::Engine as _;
    let bytes = base64::engine::general_purpose::STANDARD.decode(text);
    serde_json::from_slice(&bytes.unwrap()).unwrap()
}

#[test]
#[ignore = "needs Chromium"]
fn the_page_lives_in_a_browser() {
    let folder = tempfile::tempdir().unwrap();
    let page = run_with(&folder.path().join("run"), HOSTILE);
    let found = found_in(folder.path(), &page, AFTER);
    assert!(is_as_opened(&found), "{found}");
    assert_eq!(found["cut_before"], "inset(0px 0px 0px 50%)");
    assert_eq!(found["cut_after"], "inset(0px 0px 0px 80%)");
    // The ball is red, nothing is around it, and near enough it fills the view.
    let color = |key: &str| [0, 1, 2].map(|i| found[key][i].as_u64().unwrap());
    let is_red = |[r, g, b]: [u64; 3]| r > 200 && g < 40 && b < 40;
    assert!(is_red(color("scene_centre")), "{found}");
    assert_eq!(color("scene_corner"), [0, 0, 0]);
    assert!(is_red(color("scene_near")), "{found}");
    // The focus is seen where the camera's axis meets the image.
    let expected = [
        PRINCIPAL.0 / f64::from(SIZE.0),
        PRINCIPAL.1 / f64::from(SIZE.1),
    ];
    for (i, expected) in expected.iter().enumerate() {
        let share = found["ball"][i].as_f64().unwrap();
        assert!((share - expected).abs() < 0.003, "{found}");
    }
    assert_eq!(found["globe_turns"], true);
    assert_eq!(found["map_changes"], true);
    let cameras = found["cameras"].as_array().unwrap();
    assert_eq!(cameras.len(), 3);
    assert_eq!(cameras[2], format!("test: {HOSTILE}"));
    assert_eq!(found["title"], "run - gspotential");
}

/// Without this, "no problems" would say nothing.
#[test]
#[ignore = "needs Chromium"]
fn a_broken_page_is_found_out() {
    let folder = tempfile::tempdir().unwrap();
    let page = run_with(&folder.path().join("run"), "t.png");
    let broken = page.replacen("\"quantities\":", "\"nothing\":", 1);
    assert_ne!(page, broken);
    let found = found_in(folder.path(), &broken, AFTER);
    assert!(!is_as_opened(&found));
}
