//! Every module of the crate uses only the modules below it; `unsafe` and Vulkan stay in their homes.

use std::collections::BTreeSet;

use crate::imports::Crate;
use crate::{code, is_test, program, sources};

/// Every module of the crate, from the ground up, and the modules that it may use. `measure` is listed by its inner
/// modules, which are modules of their own here.
const EDGES: [(&str, &str); 24] = [
    ("host_memory", ""),
    ("threads", "host_memory"),
    ("files", ""),
    ("quantities", ""),
    ("rules", ""),
    ("options", "quantities rules"),
    ("scene", "host_memory files"),
    ("procedural", "host_memory quantities scene"),
    ("formats", "host_memory files scene procedural"),
    ("camera", "files"),
    ("pixels", "host_memory files threads"),
    ("gpu", "host_memory"),
    ("reference", "scene camera rules pixels"),
    ("lod", "scene rules"),
    ("packing", "host_memory scene options rules"),
    ("pagefile", "host_memory threads files formats lod packing scene options rules"),
    ("render", "host_memory threads gpu lod scene formats packing pagefile camera rules options pixels"),
    ("measure::metrics", "pixels"),
    ("measure::bench", "threads files gpu render scene pagefile camera rules options pixels"),
    (
        "measure::trade",
        "files gpu render reference scene packing camera rules options pixels measure::bench measure::metrics",
    ),
    ("measure::plot", "files measure::bench measure::metrics measure::trade"),
    ("measure::prune", "render scene formats camera options pixels measure::bench measure::metrics"),
    (
        "viewer",
        "files host_memory threads gpu render reference scene procedural formats packing pagefile camera rules options \
         pixels measure::bench measure::metrics measure::trade",
    ),
    ("serve", "threads files gpu viewer pixels scene"),
];

/// The rooms inside `render`, from the ground up, and the rooms that each may use.
const RENDER_ROOMS: [(&str, &str); 31] = [
    ("shaders", ""),
    ("readback", ""),
    ("band", "shaders"),
    ("patches", "band"),
    ("pack", "shaders band"),
    ("upscale", "shaders"),
    ("capacity", "shaders"),
    ("path", "capacity"),
    ("scene", "shaders"),
    ("frame", "shaders band patches scene"),
    ("constants", "shaders frame"),
    ("arrays", "shaders scene constants"),
    ("portable", "shaders capacity scene frame constants"),
    ("rays", "shaders band scene frame constants portable"),
    ("fast", "shaders band capacity scene frame constants portable"),
    ("fast_rays", "shaders band scene frame rays fast"),
    ("inspect", "shaders band scene frame constants portable rays"),
    ("fit", "shaders"),
    ("marks", "shaders scene frame"),
    ("prune", "shaders readback capacity scene frame constants portable"),
    ("pages", "shaders scene frame fast inspect"),
    ("lod", "shaders scene frame constants fast inspect pages"),
    ("streaming", "shaders scene frame lod"),
    ("slabs", "shaders capacity scene frame portable fast inspect pages lod"),
    ("recorded", "shaders path lod streaming slabs"),
    (
        "path_choice",
        "shaders capacity path scene frame portable rays fast fast_rays inspect lod streaming slabs \
         recorded",
    ),
    ("self_test", "shaders readback capacity path scene frame fast path_choice"),
    ("sample", "band patches path frame scene pages lod path_choice self_test"),
    (
        "renderer",
        "shaders readback band upscale capacity path scene frame constants inspect lod streaming slabs recorded \
         path_choice self_test sample",
    ),
    ("frame_queue", "band pack capacity path inspect recorded renderer"),
    ("split", "band pack slabs recorded renderer frame_queue"),
];

/// The rooms inside `viewer`, from the ground up, and the rooms that each may use.
const VIEWER_ROOMS: [(&str, &str); 7] = [
    ("jobs", ""),
    ("model", "jobs"),
    ("actions", "jobs model"),
    ("panels", "jobs model actions"),
    ("frame", "model panels"),
    ("remote", "model actions frame"),
    ("window", "model frame remote"),
];

/// Modules that may use every other.
const TOP: [&str; 3] = ["cli", "main", "lib"];

/// Words that only these modules may write.
const HOMES: [(&str, &[&str]); 3] = [("unsafe ", &["gpu", "host_memory"]), ("ash::", &["gpu"]), ("vk::", &["gpu"])];

/// The module of a source file, as the table names it; none for the file that only lists the modules of `measure`.
fn module(name: &str) -> Option<String> {
    let mut parts = name.trim_end_matches(".rs").split('/');
    match (parts.next().unwrap(), parts.next()) {
        ("measure", None | Some("mod")) => None,
        ("measure", Some(inner)) => Some(format!("measure::{inner}")),
        (outer, _) => Some(outer.to_owned()),
    }
}

/// The modules that a source uses by paths from the crate's root.
fn used(text: &str) -> Vec<String> {
    let code = code(text);
    let name = |text: &str| text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let target = |rest: &str| match name(rest) {
        outer if outer == "measure" => format!("measure::{}", name(rest.trim_start_matches("measure::"))),
        outer => outer,
    };
    program(&code).split("crate::").skip(1).map(target).collect()
}

/// True if the text has the word, and not only as the end of a longer one.
fn has_word(text: &str, word: &str) -> bool {
    let is_longer = |place: usize| text[..place].ends_with(|c: char| c.is_alphanumeric() || c == '_');
    text.match_indices(word).any(|(place, _)| !is_longer(place))
}

/// What is wrong with these sources, one line each.
fn violations(sources: &[(String, String)]) -> Vec<String> {
    let mut found = Vec::new();
    // Tests may use whatever makes a scene.
    for (name, text) in sources.iter().filter(|(name, _)| !is_test(name)) {
        let Some(module) = module(name) else { continue };
        for (word, homes) in HOMES {
            if has_word(&code(text), word) && !homes.contains(&module.as_str()) {
                found.push(format!("{name}: `{}` outside of {}", word.trim(), homes.join(" and ")));
            }
        }
        if TOP.contains(&module.as_str()) {
            continue;
        }
        let Some((_, allowed)) = EDGES.iter().find(|(m, _)| *m == module) else {
            found.push(format!("{name}: module {module} is not in the table"));
            continue;
        };
        let may_use = |target: &str| target == module || allowed.split(' ').any(|other| other == target);
        for target in used(text).iter().filter(|target| !may_use(target)) {
            found.push(format!("{name}: {module} may not use {target}"));
        }
    }
    found
}

/// The room of a source file inside a module; none for the file that only lists the rooms.
fn room<'a>(module: &str, name: &'a str) -> Option<&'a str> {
    let inside = name.strip_prefix(module)?.strip_prefix('/')?.split('/').next()?;
    Some(inside.trim_end_matches(".rs")).filter(|room| *room != "mod")
}

/// The imports between rooms inside a module that the table forbids, one line each.
fn violations_inside(module: &str, rooms: &[(&str, &str)], sources: &[(String, String)]) -> Vec<String> {
    let place = |room: &str| rooms.iter().position(|(name, _)| *name == room);
    let mut found = BTreeSet::new();
    for (file, used) in Crate::new(sources).edges() {
        let (Some(from), Some(to)) = (room(module, file), room(module, used)) else { continue };
        if from == to || is_test(file) {
            continue;
        }
        let may_use = place(from).is_some_and(|row| rooms[row].1.split(' ').any(|allowed| allowed == to));
        if !may_use {
            found.insert(format!("{file}: {from} may not use {to}"));
        }
    }
    found.into_iter().collect()
}

#[test]
fn rooms_inside_a_module_use_only_rooms_below() {
    for (module, rooms) in [("render", &RENDER_ROOMS[..]), ("viewer", &VIEWER_ROOMS[..])] {
        for (row, (room, allowed)) in rooms.iter().enumerate() {
            let is_below = |other: &str| rooms[..row].iter().any(|(name, _)| *name == other);
            assert!(allowed.split(' ').all(|other| other.is_empty() || is_below(other)), "{room} uses a room above it");
        }
        assert_eq!(violations_inside(module, rooms, &sources()), Vec::<String>::new());
    }
}

#[test]
fn a_forbidden_edge_inside_render_is_found() {
    let sources = [
        ("render/mod.rs", "mod frame;\nmod scene;\nmod slabs;\npub use slabs::Slab;"),
        ("render/frame.rs", "use super::scene::Scene;\npub struct Frame(Scene);"),
        ("render/scene/mod.rs", "mod cache;\npub struct Scene;"),
        ("render/scene/cache.rs", "use crate::render::Slab;\npub struct Cache(Slab);"),
        ("render/slabs/mod.rs", "mod list;\npub use list::Slab;"),
        ("render/slabs/list.rs", "use crate::render::frame::Frame;\npub struct Slab(Frame);"),
        ("lib.rs", "mod render;"),
    ];
    let owned: Vec<_> = sources.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect();
    assert_eq!(violations_inside("render", &RENDER_ROOMS, &owned), ["render/scene/cache.rs: scene may not use slabs"]);
}

#[test]
fn modules_use_only_what_the_table_allows() {
    assert_eq!(violations(&sources()), Vec::<String>::new());
}

#[test]
fn a_forbidden_edge_is_found() {
    let source = |name: &str, text: &str| vec![(name.to_owned(), text.to_owned())];
    assert_eq!(
        violations(&source("scene/ply.rs", "use crate::render::PortablePipeline;")),
        ["scene/ply.rs: scene may not use render"]
    );
    assert_eq!(
        violations(&source("measure/bench/run.rs", "use crate::measure::trade::Knob;")),
        ["measure/bench/run.rs: measure::bench may not use measure::trade"]
    );
    assert_eq!(
        violations(&source("render/a.rs", "let x = unsafe { y() };")),
        ["render/a.rs: `unsafe` outside of gpu and host_memory"]
    );
    assert_eq!(violations(&source("render/a.rs", "use ash::vk;")), ["render/a.rs: `ash::` outside of gpu"]);
    assert_eq!(violations(&source("render/a.rs", "use twox_hash::XxHash3_64;")), Vec::<String>::new());
    assert_eq!(violations(&source("fresh.rs", "")), ["fresh.rs: module fresh is not in the table"]);
    assert_eq!(violations(&source("scene/ply.rs", "// use crate::render;")), Vec::<String>::new());
}
