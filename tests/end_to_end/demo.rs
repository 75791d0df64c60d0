//! `demo`: one command, everything there.

use crate::command::{folder, vitruvian, word};

#[test]
fn the_demo_prints_its_tables_and_writes_a_page_whose_links_all_lead_somewhere() {
    let folder = folder();
    let out = folder.path().join("new/demo");
    let run = vitruvian(&["demo", "-o", word(&out), "--resolution", "48"]).done();
    for words in [
        "synthesise",
        "fit joints",
        "fit masks",
        "fitted body",
        "coarse surface",
        "refined surface",
        "together",
        "P2S cm",
        "Chamfer",
        "IoU",
    ] {
        assert!(run.out.contains(words), "{words} in {}", run.out);
    }
    let page = std::fs::read_to_string(out.join("index.html")).expect("the page");
    let links: Vec<&str> = ["href=\"", "src=\""]
        .iter()
        .flat_map(|before| page.split(before).skip(1).filter_map(|rest| rest.split('"').next()))
        .collect();
    assert!(links.len() >= 12, "{links:?}");
    for link in links {
        assert!(out.join(link).is_file(), "{link}");
    }
}
