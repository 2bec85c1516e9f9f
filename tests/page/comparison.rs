//! The page over several runs.

use std::path::Path;

use gspotential::report::{SceneRuns, write_comparison};

use super::browser::{found_in, is_as_opened};
use super::content::HOSTILE;
use super::{finished, metrics, photograph};

/// After the page's scripts: chooses the photograph on the left.
const AFTER: &str = r##"<script>
setTimeout(() => {
  const pictures = Array.from(document.querySelectorAll(".compare img"));
  const found = { problems, title: document.title };
  found.before = pictures.map((img) => img.alt);
  const same = () => pictures[0].src === pictures[1].src;
  found.renders_are_equal = same();
  const left = document.querySelector("select.left");
  found.names = Array.from(left.options, (option) => option.text);
  left.value = "0";
  left.dispatchEvent(new Event("change"));
  found.after = pictures.map((img) => img.alt);
  found.photograph_differs = !same();
  Promise.allSettled(pictures.map((img) => img.decode())).then((decoded) => {
    found.shown = decoded.every((one) => one.status === "fulfilled");
    report(found);
  });
}, 500);
</script>"##;

/// A page over `n` equal runs of a scene with one test view named `name`.
fn compared(folder: &Path, n: usize, name: &str) -> String {
    let mut scene = SceneRuns::new(&metrics(name).scene, &[photograph(name)], n).unwrap();
    for i in 0..n {
        let run = finished(&folder.join(format!("run <{i}>")), name);
        scene.add(&run).unwrap();
    }
    let path = folder.join("runs.html");
    write_comparison(&path, &[scene]).unwrap();
    std::fs::read_to_string(path).unwrap()
}

#[test]
fn several_runs_share_a_page_and_names_are_escaped() {
    let folder = tempfile::tempdir().unwrap();
    let page = compared(folder.path(), 2, HOSTILE);
    assert!(!page.contains("<script>document.title") && !page.contains("run <1>"));
    for text in ["run &lt;0&gt;", "run &lt;1&gt;", "12.34", "2 runs"] {
        assert!(page.contains(text), "{text}");
    }
    let scripts = page.matches("<script").count();
    assert_eq!(scripts, page.matches("</script").count());
    // The photograph and two renders, each once.
    assert_eq!(page.matches("data:image/jpeg;base64,").count(), 3);
    assert_eq!(page.matches("<svg").count(), 4);
}

#[test]
fn curves_of_more_runs_than_colours_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let page = compared(folder.path(), 9, "t.png");
    assert!(!page.contains("<svg") && page.contains("at most 8 runs"));
}

#[test]
#[ignore = "needs Chromium"]
fn pictures_are_chosen_in_a_browser() {
    let folder = tempfile::tempdir().unwrap();
    let page = compared(folder.path(), 2, HOSTILE);
    let found = found_in(folder.path(), &page, AFTER);
    assert!(is_as_opened(&found), "{found}");
    assert_eq!(found["title"], "2 runs - gspotential");
    let names = serde_json::json!(["photograph", "run <0>", "run <1>"]);
    assert_eq!(found["names"], names);
    assert_eq!(found["before"], serde_json::json!(["run <0>", "run <1>"]));
    assert_eq!(found["after"], serde_json::json!(["photograph", "run <1>"]));
    for key in ["renders_are_equal", "photograph_differs", "shown"] {
        assert_eq!(found[key], true, "{key}: {found}");
    }
}
