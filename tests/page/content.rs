//! The page's text.

use super::run_with;

/// It ends a script and opens one, breaks out of an attribute, and is a name of a view all the same.
pub(crate) const HOSTILE: &str = "x\"'><script>document.title=\"taken\"</script>&amp;.png";

#[test]
fn names_from_files_are_escaped() {
    let folder = tempfile::tempdir().unwrap();
    let page = run_with(&folder.path().join("<img src=x onerror=alert(1)>"), HOSTILE);
    assert!(!page.contains("<script>document.title"), "as an element");
    assert!(!page.contains("\"taken\"</script>"), "within JSON");
    assert!(!page.contains("<img src=x"), "the run's own name");
    assert!(page.contains("&lt;script&gt;document.title="), "as text");
    assert!(page.contains("\\u003cscript>document.title="), "as JSON");
    // Each script is closed by its own end alone.
    let (open, closed) = (
        page.matches("<script").count(),
        page.matches("</script").count(),
    );
    assert_eq!(open, closed);
    let plain = run_with(&folder.path().join("plain"), "t.png");
    assert_eq!(open, plain.matches("<script").count());
}

#[test]
fn a_page_fetches_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let page = run_with(&folder.path().join("run"), "t.png");
    assert!(page.contains("default-src 'none'"));
    for outside in [
        "src=\"http",
        "href=",
        "@import",
        "url(",
        "fetch(",
        "import(",
    ] {
        assert!(!page.contains(outside), "{outside}");
    }
    // Plots name their namespace, which nobody fetches.
    let addresses = page.matches("://").count();
    assert_eq!(
        addresses,
        page.matches("xmlns=\"http://www.w3.org/2000/svg\"").count()
    );
}

#[test]
fn a_page_has_the_figures_and_pictures_of_its_run() {
    let folder = tempfile::tempdir().unwrap();
    let page = run_with(&folder.path().join("run"), "t.png");
    for text in [
        "12.34",
        "0.5000",
        "n/a",
        "virtual (1)",
        "training (2)",
        "test (1)",
    ] {
        assert!(page.contains(text), "{text}");
    }
    // Render, photograph, error map and the sheet of virtual views.
    assert_eq!(page.matches("data:image/jpeg;base64,").count(), 4);
    // Loss, size, PSNR and SSIM.
    assert_eq!(page.matches("<svg").count(), 4);
}
