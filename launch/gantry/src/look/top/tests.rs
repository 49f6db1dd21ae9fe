//! The screen with made-up views: what it shows in which size, and what keys do to it.

use std::time::Duration;

use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};

use super::app::{App, Page, Panel, Wish};
use super::screen::{self, Style};
use super::view::{Measured, ProcessRow, SharedMemory, StageRow, TopicRow, View, World};
use super::{json, plain, text_of};
use crate::cli::Column;
use crate::look::census::{Kind, Member};

fn member(pid: u32, name: &str) -> Member {
    Member {
        pid: Some(pid),
        name: name.into(),
    }
}

fn topic(name: &str, kind: Kind, type_name: &str, rate_hz: Option<f64>) -> TopicRow {
    TopicRow {
        topic: name.into(),
        kind,
        type_name: type_name.into(),
        rate_hz,
        age_nanos: rate_hz.map(|_| 12_300_000),
        since_sensor_nanos: None,
        bytes_per_sec: rate_hz.map(|hz| hz * 1_920_000.0),
        payload_bytes: Some(1_920_000),
        max_payload_bytes: 1_920_000,
        seq: Some(7),
        tick: Some(7),
        writers: vec![member(100, "simd")],
        readers: vec![],
        n_readers: 0,
        max_readers: 8,
        measured: None,
        rate_history: vec![20.0, 10.0, 20.0],
    }
}

fn view() -> View {
    let mut rgb = topic("ego/front/rgb", Kind::Frames, "rgb", Some(20.0));
    rgb.readers = vec![member(200, "gantry-view"), member(300, "detector")];
    rgb.n_readers = 2;
    rgb.measured = Some(Measured {
        samples: 100,
        lost: 3,
        ..Measured::default()
    });
    let mut boxes = topic("people/boxes", Kind::Results, "boxes2d", Some(9.5));
    boxes.writers = vec![member(300, "detector")];
    boxes.readers = vec![member(200, "gantry-view")];
    (boxes.n_readers, boxes.max_readers) = (1, 1);
    boxes.since_sensor_nanos = Some(31_000_000);
    View {
        domain: "lab".into(),
        interval_secs: 1.0,
        world: Some(World {
            tick: 1234,
            sim_secs: 61.7,
            speed: Some(0.98),
        }),
        shared_memory: SharedMemory {
            size_bytes: 2_000_000_000,
            free_bytes: 1_500_000_000,
        },
        processes: vec![
            ProcessRow {
                pid: 100,
                name: "simd".into(),
                cpu_percent: Some(87.4),
                resident_bytes: Some(420_000_000),
                uptime_secs: Some(75),
                stopped: false,
                writes: vec!["ego/front/depth".into(), "ego/front/rgb".into()],
                reads: vec![],
                stages: vec![StageRow {
                    stage: "physics".into(),
                    cpu_percent: 12.5,
                    cpu_ms_per_tick: Some(6.25),
                }],
            },
            ProcessRow {
                pid: 300,
                name: "detector".into(),
                stopped: true,
                writes: vec!["people/boxes".into()],
                reads: vec!["ego/front/rgb".into()],
                ..ProcessRow::default()
            },
        ],
        topics: vec![
            topic("ego/front/depth", Kind::Frames, "depth", None),
            rgb,
            boxes,
            topic("world/info", Kind::Document, "document", Some(0.0)),
        ],
    }
}

fn app() -> App {
    App::new(view(), true, Column::Name, "", Duration::from_secs(1))
}

fn press(app: &mut App, code: KeyCode) -> Wish {
    app.key(KeyEvent::new(code, KeyModifiers::NONE))
}

fn type_all(app: &mut App, keys: &str) {
    for key in keys.chars() {
        press(app, KeyCode::Char(key));
    }
}

fn shown(app: &App, width: u16, height: u16) -> String {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    let style = Style { coloured: true };
    terminal
        .draw(|frame| screen::draw(frame, app, style))
        .unwrap();
    text_of(terminal.backend().buffer())
}

/// The line that begins with `start` after the table's frame.
fn row<'a>(text: &'a str, start: &str) -> &'a str {
    let is_it = |line: &&str| line.trim_start_matches(['│', ' ']).starts_with(start);
    text.lines()
        .find(is_it)
        .unwrap_or_else(|| panic!("no row {start:?} in\n{text}"))
}

#[test]
fn tables_show_who_does_what_how_fast() {
    let text = shown(&app(), 140, 30);
    assert!(text.starts_with("gantry top · domain lab · tick 1234 · 61.70 s simulated · ×0.98 · /dev/shm 1.50 GB of 2.00 GB free"), "{text}");
    let rgb = row(&text, "ego/front/rgb");
    for cell in [
        "rgb",
        "20.0",
        "12.3 ms",
        "38.4 MB",
        "3●",
        "2/8",
        "simd",
        "detector, gantry-view",
    ] {
        assert!(rgb.contains(cell), "{cell} in {rgb}");
    }
    let depth = row(&text, "ego/front/depth");
    assert!(depth.contains('–') && depth.contains("0/8"), "{depth}");
    let simd = row(&text, "100");
    assert!(
        simd.contains("87") && simd.contains("420 MB") && simd.contains("2: ego/front/depth"),
        "{simd}"
    );
    assert!(row(&text, "300").contains("detector stopped"));
    assert!(
        text.contains("nothing is read") && text.contains("top reads itself"),
        "{text}"
    );
}

#[test]
fn a_small_terminal_gets_a_sentence_and_a_narrow_one_a_table() {
    let text = shown(&app(), 30, 8).replace('\n', " ");
    assert!(
        text.contains("30 × 8") && text.contains("50 × 12"),
        "{text}"
    );
    for (width, height) in [(50, 12), (80, 24), (200, 60)] {
        let text = shown(&app(), width, height);
        assert!(text.contains("Topics: 4"), "{width} × {height}\n{text}");
    }
    for (width, height) in [(1, 1), (0, 0), (49, 200), (200, 11)] {
        shown(&app(), width, height);
    }
}

#[test]
fn keys_sort_filter_and_select() {
    let mut app = app();
    let names = |app: &App| {
        app.topics()
            .iter()
            .map(|row| row.topic.clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(names(&app)[0], "ego/front/depth");
    type_all(&mut app, "ss");
    assert_eq!(app.sort, Column::Rate);
    assert_eq!(
        names(&app),
        [
            "ego/front/rgb",
            "people/boxes",
            "world/info",
            "ego/front/depth"
        ]
    );
    type_all(&mut app, "r");
    assert_eq!(names(&app)[3], "ego/front/rgb");
    type_all(&mut app, "r/boxqs");
    assert!(names(&app).is_empty(), "q and s went into the filter");
    press(&mut app, KeyCode::Backspace);
    press(&mut app, KeyCode::Backspace);
    press(&mut app, KeyCode::Enter);
    assert_eq!(names(&app), ["people/boxes"]);
    assert_eq!(app.processes().len(), 1, "the detector writes it");
    assert!(shown(&app, 100, 24).contains("with \"box\""));
    press(&mut app, KeyCode::Esc);
    assert_eq!(names(&app).len(), 4);
    press(&mut app, KeyCode::Down);
    press(&mut app, KeyCode::Down);
    assert_eq!(app.topic().unwrap().topic, "people/boxes");
    press(&mut app, KeyCode::End);
    assert_eq!(app.selected_topic(), Some(3));
    press(&mut app, KeyCode::Down);
    assert_eq!(app.selected_topic(), Some(3), "the last row stays the last");
    press(&mut app, KeyCode::Home);
    assert_eq!(app.selected_topic(), Some(0));
    // The selection stays with its topic when rows move.
    let before = app.topic().unwrap().topic.clone();
    type_all(&mut app, "r");
    assert_eq!(app.topic().unwrap().topic, before);
}

#[test]
fn keys_quit_pause_and_ask_for_measuring() {
    let mut app = app();
    assert_eq!(press(&mut app, KeyCode::Char('m')), Wish::None);
    assert!(shown(&app, 100, 24).contains("select a topic first"));
    press(&mut app, KeyCode::Down);
    let wish = press(&mut app, KeyCode::Char('M'));
    let topic = "ego/front/depth".to_owned();
    assert_eq!(
        wish,
        Wish::Measure {
            topic,
            even_if_unread: true
        }
    );
    type_all(&mut app, "p");
    assert!(shown(&app, 160, 24).contains("PAUSED"));
    let mut newer = view();
    newer.topics.clear();
    app.update(newer.clone());
    assert_eq!(app.view.topics.len(), 4, "a paused screen stays");
    type_all(&mut app, "p");
    app.update(newer);
    assert!(app.view.topics.is_empty());
    shown(&app, 80, 24);
    type_all(&mut app, "+");
    assert_eq!(app.every, Duration::from_millis(500));
    type_all(&mut app, "--");
    assert_eq!(app.every, Duration::from_secs(2));
    assert_eq!(press(&mut app, KeyCode::Char('q')), Wish::Quit);
    let ctrl_c = KeyEvent::new(KeyCode::Char('c'), KeyModifiers::CONTROL);
    app.typing = true;
    assert_eq!(app.key(ctrl_c), Wish::Quit);
}

#[test]
fn details_graph_and_help_have_their_pages() {
    let mut app = app();
    press(&mut app, KeyCode::Down);
    press(&mut app, KeyCode::Down);
    press(&mut app, KeyCode::Enter);
    assert_eq!(app.page, Page::Details);
    let text = shown(&app, 120, 30);
    for part in [
        "ego/front/rgb",
        "2 of 8 places: gantry-view (200), detector (300)",
        "100 samples, 3 lost",
        "at most 20.0 Hz",
    ] {
        assert!(text.contains(part), "{part} in\n{text}");
    }
    // The arrow keys go on to the next topic.
    press(&mut app, KeyCode::Down);
    let text = shown(&app, 120, 30);
    assert!(
        text.contains("people/boxes") && text.contains("31.0 ms from the oldest sensor frame"),
        "{text}"
    );
    press(&mut app, KeyCode::Esc);
    assert_eq!(app.page, Page::Tables);
    press(&mut app, KeyCode::Tab);
    assert_eq!(app.panel, Panel::Processes);
    press(&mut app, KeyCode::Enter);
    let text = shown(&app, 120, 30);
    for part in ["87.4 % of a core", "physics", "12.5 % of a core, 6.25 ms"] {
        assert!(text.contains(part), "{part} in\n{text}");
    }
    press(&mut app, KeyCode::Char('g'));
    let text = shown(&app, 120, 30);
    assert!(
        text.contains("writes people/boxes") && text.contains("→ gantry-view (200)"),
        "{text}"
    );
    press(&mut app, KeyCode::PageDown);
    shown(&app, 120, 30);
    press(&mut app, KeyCode::Char('?'));
    assert!(shown(&app, 120, 40).contains("places taken and places there are"));
    press(&mut app, KeyCode::Char('?'));
    assert_eq!(app.page, Page::Tables);
}

#[test]
fn plain_text_and_json_hold_every_row() {
    let text = plain(&app(), 120).unwrap();
    for name in [
        "ego/front/depth",
        "ego/front/rgb",
        "people/boxes",
        "world/info",
        "detector",
    ] {
        assert!(text.contains(name), "{name} in\n{text}");
    }
    assert!(
        !text.contains("q quit") && !text.contains('\u{1b}'),
        "{text}"
    );
    assert_eq!(
        text.lines()
            .filter(|line| line.trim_matches(['│', ' ']).is_empty())
            .count(),
        0,
        "{text}"
    );
    let mut filtered = app();
    filtered.filter = "people".into();
    let value: serde_json::Value = serde_json::from_str(&json(&filtered).unwrap()).unwrap();
    assert_eq!(value["topics"].as_array().unwrap().len(), 1);
    let row = &value["topics"][0];
    assert_eq!(
        (&row["type"], &row["kind"]),
        (&"boxes2d".into(), &"results".into())
    );
    assert_eq!(row["since_sensor_nanos"], 31_000_000);
    assert_eq!(row["written_by"][0]["name"], "detector");
    assert_eq!(value["world"]["tick"], 1234);
}
