//! Which files of a crate use which others, read from the source with `syn`.
//!
//! A file that declares a module depends on it (`mod x;` is an arrow to `x.rs`), and so does a file
//! that names an item of another file, whether through `use` or by a path in an expression, a type
//! or the tokens of a macro call. A re-export is followed to the file that defines the item.
//! Because declaring is an arrow too, a module that imports something from the file that declares
//! it, or from any file further up, closes a circle.
//! Code under `#[cfg(test)]` is not read: unit tests may look at everything.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use proc_macro2::{TokenStream, TokenTree};
use syn::visit::Visit;

/// Arrows between the source files of one crate.
pub struct CrateFiles {
    /// Root file (`src/lib.rs` or `src/main.rs`) relative to the repository.
    pub root: String,
    /// Module path of every file, such as `["rpc", "physics"]`; the root file has an empty one.
    pub files: BTreeMap<String, Vec<String>>,
    /// `(from, to)`: `from` names items that `to` defines; the value has a few of the names.
    pub arrows: BTreeMap<(String, String), BTreeSet<String>>,
}

/// One module while its crate is read.
#[derive(Default)]
struct Module {
    /// File that holds it; an inline module shares its parent's.
    file: String,
    parent: Option<usize>,
    children: BTreeMap<String, usize>,
    /// Items defined here.
    items: BTreeSet<String>,
    /// Imported names and the paths they stand for.
    imports: BTreeMap<String, Vec<String>>,
    /// Paths of `use path::*`.
    globs: Vec<Vec<String>>,
    /// Every path written in this module.
    paths: BTreeSet<Vec<String>>,
}

/// What a path names.
#[derive(Clone, Copy, PartialEq)]
enum Target {
    Module(usize),
    Item(usize),
}

struct Reader<'a> {
    modules: Vec<Module>,
    /// Macros with `#[macro_export]`, which live at the crate's root.
    exported_macros: BTreeMap<String, usize>,
    relative: &'a dyn Fn(&Path) -> String,
}

/// Reads the crate whose root file is `root`.
pub fn read_crate(root: &Path, relative: &dyn Fn(&Path) -> String) -> CrateFiles {
    let mut reader = Reader {
        modules: Vec::new(),
        exported_macros: BTreeMap::new(),
        relative,
    };
    let folder = root.parent().expect("a root file lies in src").to_owned();
    reader.file(root, &folder, None);
    let mut arrows: BTreeMap<(String, String), BTreeSet<String>> = BTreeMap::new();
    for index in 0..reader.modules.len() {
        let from = reader.modules[index].file.clone();
        for child in reader.modules[index].children.values() {
            let to = &reader.modules[*child].file;
            if *to != from {
                arrows.entry((from.clone(), to.clone())).or_default();
            }
        }
        for path in reader.modules[index].paths.clone() {
            let Some(target) = reader.resolve(index, &path, 0) else {
                continue;
            };
            let (Target::Module(module) | Target::Item(module)) = target;
            // A path that ends at a module names no item of it: `use super::wire;` and then
            // `wire::read()` is an arrow through the second path.
            if matches!(target, Target::Module(_)) {
                continue;
            }
            let to = &reader.modules[module].file;
            if *to != from {
                let name = path.last().expect("paths have a name").clone();
                arrows
                    .entry((from.clone(), to.clone()))
                    .or_default()
                    .insert(name);
            }
        }
    }
    let mut files = BTreeMap::new();
    for index in 0..reader.modules.len() {
        let module = &reader.modules[index];
        let is_own_file = module
            .parent
            .is_none_or(|parent| reader.modules[parent].file != module.file);
        if is_own_file {
            files.insert(module.file.clone(), reader.path_of(index));
        }
    }
    CrateFiles {
        root: relative(root),
        files,
        arrows,
    }
}

impl Reader<'_> {
    fn path_of(&self, index: usize) -> Vec<String> {
        let Some(parent) = self.modules[index].parent else {
            return Vec::new();
        };
        let mut path = self.path_of(parent);
        let (name, _) = self.modules[parent]
            .children
            .iter()
            .find(|(_, child)| **child == index)
            .expect("a module is its parent's child");
        path.push(name.clone());
        path
    }

    /// Reads a file as a module; `folder` is where its child modules lie.
    fn file(&mut self, path: &Path, folder: &Path, parent: Option<usize>) -> usize {
        let text = std::fs::read_to_string(path)
            .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let parsed = syn::parse_file(&text)
            .unwrap_or_else(|error| panic!("{}: {error}", (self.relative)(path)));
        let index = self.modules.len();
        self.modules.push(Module {
            file: (self.relative)(path),
            parent,
            ..Module::default()
        });
        self.items(index, &parsed.items, folder);
        index
    }

    fn items(&mut self, index: usize, items: &[syn::Item], folder: &Path) {
        for item in items.iter().filter(|item| !is_for_tests(attributes(item))) {
            if let syn::Item::Mod(module) = item {
                self.module(index, module, folder);
                continue;
            }
            if let syn::Item::Use(import) = item {
                self.import(index, &mut Vec::new(), &import.tree);
                continue;
            }
            if let syn::Item::Macro(definition) = item
                && let Some(name) = &definition.ident
            {
                self.modules[index].items.insert(name.to_string());
                if definition
                    .attrs
                    .iter()
                    .any(|a| a.path().is_ident("macro_export"))
                {
                    self.exported_macros.insert(name.to_string(), index);
                }
            }
            if let Some(name) = name_of(item) {
                self.modules[index].items.insert(name);
            }
            let mut paths = Paths::default();
            paths.visit_item(item);
            self.modules[index].paths.extend(paths.found);
            for (path, name) in paths.imports {
                self.modules[index].paths.insert(path.clone());
                self.modules[index].imports.entry(name).or_insert(path);
            }
        }
    }

    fn module(&mut self, index: usize, module: &syn::ItemMod, folder: &Path) {
        let name = module.ident.to_string();
        let child = match &module.content {
            Some((_, items)) => {
                let child = self.modules.len();
                self.modules.push(Module {
                    file: self.modules[index].file.clone(),
                    parent: Some(index),
                    ..Module::default()
                });
                self.items(child, items, &folder.join(&name));
                child
            }
            None => {
                let (path, inner) = module_file(module, folder);
                self.file(&path, &inner, Some(index))
            }
        };
        self.modules[index].children.insert(name, child);
    }

    fn import(&mut self, index: usize, prefix: &mut Vec<String>, tree: &syn::UseTree) {
        match tree {
            syn::UseTree::Path(path) => {
                prefix.push(path.ident.to_string());
                self.import(index, prefix, &path.tree);
                prefix.pop();
            }
            syn::UseTree::Name(name) => {
                let name = name.ident.to_string();
                self.add_import(index, prefix, &name, &name);
            }
            syn::UseTree::Rename(renamed) => {
                let (name, as_name) = (renamed.ident.to_string(), renamed.rename.to_string());
                self.add_import(index, prefix, &name, &as_name);
            }
            syn::UseTree::Glob(_) => self.modules[index].globs.push(prefix.clone()),
            syn::UseTree::Group(group) => {
                for tree in &group.items {
                    self.import(index, prefix, tree);
                }
            }
        }
    }

    fn add_import(&mut self, index: usize, prefix: &[String], name: &str, as_name: &str) {
        let mut path = prefix.to_vec();
        let mut as_name = as_name.to_owned();
        if name == "self" {
            if as_name == "self" {
                as_name = path.last().cloned().unwrap_or_default();
            }
        } else {
            path.push(name.to_owned());
        }
        self.modules[index].paths.insert(path.clone());
        self.modules[index].imports.insert(as_name, path);
    }

    /// What `path`, written in module `index`, names; `None` if it is none of this crate's.
    fn resolve(&self, index: usize, path: &[String], depth: usize) -> Option<Target> {
        // Circular re-exports end here.
        if depth > 24 {
            return None;
        }
        let (first, rest) = path.split_first()?;
        let start = match first.as_str() {
            "crate" => Target::Module(self.root_of(index)),
            "self" => Target::Module(index),
            "super" => Target::Module(self.modules[index].parent?),
            name => self.name_in(index, name, depth)?,
        };
        let mut target = start;
        for (n, segment) in rest.iter().enumerate() {
            let Target::Module(module) = target else {
                // Associated items and enum variants belong to their type's file.
                return Some(target);
            };
            target = match segment.as_str() {
                "super" => Target::Module(self.modules[module].parent?),
                "self" => Target::Module(module),
                name => match self.name_in(module, name, depth) {
                    Some(found) => found,
                    None if n + 1 == rest.len() && module == self.root_of(index) => {
                        Target::Item(*self.exported_macros.get(name)?)
                    }
                    None => return None,
                },
            };
        }
        Some(target)
    }

    /// What `name` means inside module `index`.
    fn name_in(&self, index: usize, name: &str, depth: usize) -> Option<Target> {
        let module = &self.modules[index];
        if module.items.contains(name) {
            return Some(Target::Item(index));
        }
        if let Some(child) = module.children.get(name) {
            return Some(Target::Module(*child));
        }
        if let Some(path) = module.imports.get(name) {
            // An import of an outside crate that is called like this name.
            if path.len() == 1 && path[0] == name {
                return None;
            }
            return self.resolve(index, path, depth + 1);
        }
        module.globs.iter().find_map(|path| {
            match self.resolve(index, path, depth + 1)? {
                Target::Module(from) if from != index => self.name_in(from, name, depth + 1),
                // `use Enum::*`: its variants are not listed here.
                _ => None,
            }
        })
    }

    fn root_of(&self, index: usize) -> usize {
        self.modules[index]
            .parent
            .map_or(index, |parent| self.root_of(parent))
    }
}

fn module_file(module: &syn::ItemMod, folder: &Path) -> (PathBuf, PathBuf) {
    let name = module.ident.to_string();
    for attribute in &module.attrs {
        if let syn::Meta::NameValue(pair) = &attribute.meta
            && pair.path.is_ident("path")
            && let syn::Expr::Lit(literal) = &pair.value
            && let syn::Lit::Str(path) = &literal.lit
        {
            let path = folder.join(path.value());
            let inner = path.with_extension("");
            return (path, inner);
        }
    }
    let beside = folder.join(format!("{name}.rs"));
    let inner = folder.join(&name);
    if beside.exists() {
        (beside, inner)
    } else {
        (inner.join("mod.rs"), inner)
    }
}

fn is_for_tests(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("cfg")
            && matches!(&attribute.meta, syn::Meta::List(list) if list.tokens.to_string() == "test")
    })
}

fn attributes(item: &syn::Item) -> &[syn::Attribute] {
    match item {
        syn::Item::Const(i) => &i.attrs,
        syn::Item::Enum(i) => &i.attrs,
        syn::Item::Fn(i) => &i.attrs,
        syn::Item::Impl(i) => &i.attrs,
        syn::Item::Macro(i) => &i.attrs,
        syn::Item::Mod(i) => &i.attrs,
        syn::Item::Static(i) => &i.attrs,
        syn::Item::Struct(i) => &i.attrs,
        syn::Item::Trait(i) => &i.attrs,
        syn::Item::Type(i) => &i.attrs,
        syn::Item::Use(i) => &i.attrs,
        _ => &[],
    }
}

fn name_of(item: &syn::Item) -> Option<String> {
    let name = match item {
        syn::Item::Const(i) => &i.ident,
        syn::Item::Enum(i) => &i.ident,
        syn::Item::Fn(i) => &i.sig.ident,
        syn::Item::Static(i) => &i.ident,
        syn::Item::Struct(i) => &i.ident,
        syn::Item::Trait(i) => &i.ident,
        syn::Item::Type(i) => &i.ident,
        syn::Item::Union(i) => &i.ident,
        _ => return None,
    };
    Some(name.to_string())
}

/// Collects every path of an item, also from macro calls and from imports inside functions.
#[derive(Default)]
struct Paths {
    found: BTreeSet<Vec<String>>,
    imports: Vec<(Vec<String>, String)>,
}

impl<'ast> Visit<'ast> for Paths {
    fn visit_path(&mut self, path: &'ast syn::Path) {
        if path.leading_colon.is_none() {
            let names: Vec<String> = path.segments.iter().map(|s| s.ident.to_string()).collect();
            self.found.insert(names);
        }
        syn::visit::visit_path(self, path);
    }

    fn visit_item_use(&mut self, import: &'ast syn::ItemUse) {
        flatten(&mut Vec::new(), &import.tree, &mut self.imports);
    }

    fn visit_item_mod(&mut self, module: &'ast syn::ItemMod) {
        if !is_for_tests(&module.attrs) {
            syn::visit::visit_item_mod(self, module);
        }
    }

    fn visit_macro(&mut self, call: &'ast syn::Macro) {
        self.tokens(call.tokens.clone());
        syn::visit::visit_macro(self, call);
    }
}

impl Paths {
    /// Macro arguments are tokens: every `a::b::c` in them counts as a path.
    fn tokens(&mut self, tokens: TokenStream) {
        let tokens: Vec<TokenTree> = tokens.into_iter().collect();
        let is_colon =
            |n: usize| matches!(tokens.get(n), Some(TokenTree::Punct(p)) if p.as_char() == ':');
        let mut n = 0;
        while n < tokens.len() {
            match &tokens[n] {
                TokenTree::Group(group) => self.tokens(group.stream()),
                TokenTree::Ident(ident) => {
                    let mut path = vec![ident.to_string()];
                    while is_colon(n + 1) && is_colon(n + 2) {
                        let Some(TokenTree::Ident(next)) = tokens.get(n + 3) else {
                            break;
                        };
                        path.push(next.to_string());
                        n += 3;
                    }
                    self.found.insert(path);
                }
                _ => {}
            }
            n += 1;
        }
    }
}

fn flatten(prefix: &mut Vec<String>, tree: &syn::UseTree, found: &mut Vec<(Vec<String>, String)>) {
    match tree {
        syn::UseTree::Path(path) => {
            prefix.push(path.ident.to_string());
            flatten(prefix, &path.tree, found);
            prefix.pop();
        }
        syn::UseTree::Name(name) => {
            let name = name.ident.to_string();
            found.push((
                [prefix.as_slice(), std::slice::from_ref(&name)].concat(),
                name,
            ));
        }
        syn::UseTree::Rename(renamed) => {
            let path = [prefix.as_slice(), &[renamed.ident.to_string()]].concat();
            found.push((path, renamed.rename.to_string()));
        }
        syn::UseTree::Group(group) => {
            for tree in &group.items {
                flatten(prefix, tree, found);
            }
        }
        syn::UseTree::Glob(_) => {}
    }
}
