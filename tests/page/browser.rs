//! The page in headless Chromium, where there is one: `chromium` on the path, or what
//! `GSPOTENTIAL_CHROMIUM` names.

use std::path::Path;
use std::process::Command;

use super::content::HOSTILE;
use super::run_with;

/// Before the page's own scripts: counts errors, and has frames without a screen.
const BEFORE: &str = r#"<script>
window.problems = [];
window.addEventListener("error", (e) => problems.push(String(e.message)));
console.error = (...args) => problems.push(args.join(" "));
window.requestAnimationFrame = (f) => setTimeout(() => f(performance.now()), 10);
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
setTimeout(() => {
  const compare = document.querySelector(".compare");
  const cut = () => getComputedStyle(compare.querySelectorAll("img")[1]).clipPath;
  const slider = compare.querySelector("input");
  found.cut_before = cut();
  slider.value = "80";
  slider.dispatchEvent(new Event("input"));
  found.cut_after = cut();

  found.scene_centre = centre("scene");
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
    const report = document.createElement("pre");
    report.textContent = `found:${btoa(unescape(encodeURIComponent(JSON.stringify(found))))}:found`;
    document.body.append(report);
  }, 500);
}, 500);
</script>"##;

fn browser() -> Option<String> {
    let named = std::env::var("GSPOTENTIAL_CHROMIUM").ok();
    let known = ["chromium", "chromium-browser", "google-chrome"].map(str::to_owned);
    let answers = |name: &String| {
        let asked = Command::new(name).arg("--version").output();
        asked.is_ok_and(|output| output.status.success())
    };
    named.into_iter().chain(known).find(answers)
}

/// Opens `page` with the probes around its scripts and returns what they found; None without a
/// browser.
fn open(folder: &Path, page: &str) -> Option<serde_json::Value> {
    let Some(browser) = browser() else {
        eprintln!("no Chromium here: the page is not opened");
        return None;
    };
    let probed = page.replacen("<title>", &format!("{BEFORE}<title>"), 1);
    let probed = probed.replacen("</body>", &format!("{AFTER}</body>"), 1);
    let path = folder.join("probed.html");
    std::fs::write(&path, probed).unwrap();
    let output = Command::new(browser)
        .args(["--headless=new", "--no-sandbox", "--use-angle=swiftshader"])
        .args([
            "--enable-unsafe-swiftshader",
            "--force-prefers-reduced-motion",
        ])
        .args([
            "--virtual-time-budget=5000",
            "--window-size=900,900",
            "--dump-dom",
        ])
        .arg(format!(
            "--user-data-dir={}",
            folder.join("profile").display()
        ))
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
    Some(serde_json::from_slice(&bytes.unwrap()).unwrap())
}

#[test]
fn the_page_lives_in_a_browser() {
    let folder = tempfile::tempdir().unwrap();
    let page = run_with(&folder.path().join("run"), HOSTILE);
    let Some(found) = open(folder.path(), &page) else {
        return;
    };
    assert_eq!(found["problems"], serde_json::json!([]));
    assert_eq!(found["cut_before"], "inset(0px 0px 0px 50%)");
    assert_eq!(found["cut_after"], "inset(0px 0px 0px 80%)");
    // The ball is red, nothing is around it, and near enough it fills the view.
    let color = |key: &str| [0, 1, 2].map(|i| found[key][i].as_u64().unwrap());
    let is_red = |[r, g, b]: [u64; 3]| r > 200 && g < 40 && b < 40;
    assert!(is_red(color("scene_centre")), "{found}");
    assert_eq!(color("scene_corner"), [0, 0, 0]);
    assert!(is_red(color("scene_near")), "{found}");
    assert_eq!(found["globe_turns"], true);
    assert_eq!(found["map_changes"], true);
    let cameras = found["cameras"].as_array().unwrap();
    assert_eq!(cameras.len(), 3);
    assert_eq!(cameras[2], format!("test: {HOSTILE}"));
    assert_eq!(found["title"], "run - gspotential");
}

/// Otherwise "no problems" would say nothing.
#[test]
fn a_broken_page_is_found_out() {
    let folder = tempfile::tempdir().unwrap();
    let page = run_with(&folder.path().join("run"), "t.png");
    let broken = page.replacen("\"quantities\":", "\"nothing\":", 1);
    assert_ne!(page, broken);
    let Some(found) = open(folder.path(), &broken) else {
        return;
    };
    assert_ne!(found["problems"], serde_json::json!([]));
}
