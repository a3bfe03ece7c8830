//! Which source file uses which: paths in `use` declarations and in code, followed through re-exports to the file that
//! holds the item. Calls of methods are not followed, and what a `mod.rs` uses of the files in its own folder is no
//! import: it is made of them.

use std::collections::{BTreeMap, BTreeSet};

use crate::{code, program};

/// A path of names: `crate`, `super` and `self` first if it has them.
type Path = Vec<String>;

#[derive(Default)]
struct Module {
    /// The file, as in `crate::sources`.
    file: String,
    imports: Vec<Import>,
    /// The code without tests and `use` declarations, in words: names and `::`.
    words: Vec<String>,
}

struct Import {
    path: Path,
    /// The name that it has here; `*` for all names.
    name: String,
    is_public: bool,
}

/// The modules of the crate, by their paths from its root.
pub struct Crate(BTreeMap<Path, Module>);

impl Crate {
    pub fn new(sources: &[(String, String)]) -> Self {
        let path = |name: &str| -> Path {
            let path = name.trim_end_matches(".rs").trim_end_matches("/mod");
            if path == "lib" { Vec::new() } else { path.split('/').map(str::to_owned).collect() }
        };
        let named = sources.iter().filter(|(name, _)| name != "main.rs");
        Self(named.map(|(name, text)| (path(name), Module::new(name, text))).collect())
    }

    /// Pairs of files, the first of which uses the second, which is not below it.
    pub fn edges(&self) -> BTreeSet<(&str, &str)> {
        let mut found = BTreeSet::new();
        for (at, module) in &self.0 {
            let used = |name: &String| module.words.contains(name);
            let imported = module.imports.iter().filter(|import| !import.is_public || used(&import.name));
            let paths = imported.map(|import| import.path.clone()).chain(module.paths());
            for (holder, is_item) in paths.filter_map(|path| self.resolve(at, &path, 0)) {
                let file = &self.0[&holder].file;
                if is_item && !holder.starts_with(at) {
                    found.insert((module.file.as_str(), file.as_str()));
                }
            }
        }
        found
    }

    /// The module in which `path`, written in the module `at`, ends; and whether it ends at an item in it, not at the
    /// module itself. Nothing for paths to other crates and to names of the code's own.
    fn resolve(&self, at: &[String], path: &[String], depth: usize) -> Option<(Path, bool)> {
        let (first, rest) = path.split_first()?;
        if depth > 16 {
            return None;
        }
        match first.as_str() {
            "crate" => self.walk(&[], rest, depth),
            "self" => self.walk(at, rest, depth),
            "super" => self.walk(at.split_last()?.1, rest, depth),
            _ => self.step(at, first, depth).and_then(|(module, is_item)| {
                if is_item { Some((module, true)) } else { self.walk(&module, rest, depth) }
            }),
        }
    }

    /// Follows a path downwards from a module.
    fn walk(&self, from: &[String], path: &[String], depth: usize) -> Option<(Path, bool)> {
        let Some((first, rest)) = path.split_first() else { return Some((from.to_vec(), false)) };
        if first == "super" {
            return self.walk(from.split_last()?.1, rest, depth);
        }
        match self.step(from, first, depth) {
            Some((module, false)) => self.walk(&module, rest, depth),
            Some(item) => Some(item),
            // What is defined here, by a macro or not.
            None => Some((from.to_vec(), true)),
        }
    }

    /// The module that a name in a module means, or the one that holds the item which it means.
    fn step(&self, at: &[String], name: &str, depth: usize) -> Option<(Path, bool)> {
        let child: Path = at.iter().cloned().chain([name.to_owned()]).collect();
        if self.0.contains_key(&child) {
            return Some((child, false));
        }
        let module = &self.0[at];
        if let Some(import) = module.imports.iter().find(|import| import.name == name) {
            // A name of another crate, as in `use exr::prelude`, is no name of ours.
            return (import.path[0] != name).then(|| self.resolve(at, &import.path, depth + 1))?;
        }
        let mut globs = module.imports.iter().filter(|import| import.name == "*" && import.is_public);
        globs.find_map(|import| {
            let (holder, _) = self.resolve(at, &import.path, depth + 1)?;
            self.0[&holder].defines(name).then_some((holder, true))
        })
    }
}

impl Module {
    fn new(file: &str, text: &str) -> Self {
        let code = code(text);
        let code = program(&code);
        let (mut imports, mut rest) = (Vec::new(), String::new());
        let mut open: Option<String> = None;
        for line in code.lines() {
            let is_use = |line: &str| {
                let declared = line.trim_start();
                let declared = match declared.strip_prefix("pub") {
                    Some(public) => public.trim_start_matches(|c: char| c == '(' || c == ')' || c.is_alphabetic()),
                    None => declared,
                };
                declared.trim_start().starts_with("use ") || line.trim_start().starts_with("use ")
            };
            match &mut open {
                Some(declaration) => declaration.push_str(line),
                None if is_use(line) => open = Some(line.to_owned()),
                None => rest.extend([line, "\n"]),
            }
            if let Some(declaration) = open.take_if(|declaration| declaration.contains(';')) {
                let is_public = declaration.trim_start().starts_with("pub");
                let tree = declaration.split_once("use ").unwrap().1.split(';').next().unwrap();
                expand(&[], tree, is_public, &mut imports);
            }
        }
        Self { file: file.to_owned(), imports, words: words(&rest) }
    }

    /// The paths of two names and more in the code.
    fn paths(&self) -> impl Iterator<Item = Path> {
        let mut paths: Vec<Path> = Vec::new();
        let mut continues = false;
        for word in &self.words {
            match (word.as_str(), continues) {
                ("::", _) => continues = true,
                (_, true) => {
                    paths.last_mut().unwrap().push(word.clone());
                    continues = false;
                }
                _ => paths.push(vec![word.clone()]),
            }
        }
        paths.into_iter().filter(|path| path.len() > 1)
    }

    fn defines(&self, name: &str) -> bool {
        const KEYWORDS: [&str; 7] = ["fn", "struct", "enum", "trait", "type", "const", "static"];
        self.words.windows(2).any(|pair| KEYWORDS.contains(&pair[0].as_str()) && pair[1] == name)
    }
}

/// The names and the `::` between them; other characters separate words and are left out, and so does a `::` that
/// follows or precedes none.
fn words(code: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let mut rest = code;
    let mut follows_name = false;
    while let Some(first) = rest.chars().next() {
        let length = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
        if length > 0 {
            words.push(rest[..length].to_owned());
            (rest, follows_name) = (&rest[length..], true);
        } else if let Some(after) = rest.strip_prefix("::") {
            if follows_name && after.starts_with(|c: char| c.is_alphabetic() || c == '_') {
                words.push("::".to_owned());
            }
            (rest, follows_name) = (after, false);
        } else {
            (rest, follows_name) = (&rest[first.len_utf8()..], false);
        }
    }
    words
}

/// The single imports of a tree such as `a::{b, c as d, self}`.
fn expand(before: &[String], tree: &str, is_public: bool, imports: &mut Vec<Import>) {
    let tree = tree.trim();
    if let Some((path, group)) = tree.split_once('{') {
        let names = path.split("::").map(str::trim).filter(|name| !name.is_empty()).map(str::to_owned);
        let before: Path = before.iter().cloned().chain(names).collect();
        let group = group.strip_suffix('}').expect("a group is closed");
        let (mut depth, mut start) = (0, 0);
        for (i, c) in group.char_indices().chain([(group.len(), ',')]) {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    expand(&before, &group[start..i], is_public, imports);
                    start = i + 1;
                }
                _ => {}
            }
        }
    } else if !tree.is_empty() {
        let (path, alias) = tree.split_once(" as ").map_or((tree, None), |(path, alias)| (path, Some(alias)));
        let mut path: Path = before.iter().cloned().chain(path.split("::").map(|n| n.trim().to_owned())).collect();
        let is_module = path.len() > 1 && path.last().is_some_and(|last| last == "self");
        let is_glob = path.last().is_some_and(|last| last == "*");
        if is_module || is_glob {
            path.pop();
        }
        let own = if is_glob { "*" } else { path.last().map_or("", String::as_str) };
        let name = alias.map_or(own, str::trim).to_owned();
        imports.push(Import { path, name, is_public });
    }
}
