//! The modules of a crate, read from its sources: what each imports, and how long its functions are.
//!
//! Modules are followed from `lib.rs` as the compiler does. What is compiled for tests alone is left out.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use syn::spanned::Spanned as _;
use syn::visit::{self, Visit};
use syn::{Attribute, File, Item, ItemMod, ItemUse, Meta, UseTree, Visibility};

/// A module by the names on the way to it from the root of its crate.
pub type ModulePath = Vec<String>;

/// One module.
#[derive(Debug, Default)]
pub struct Module {
    /// File, from the folder of the crate.
    pub file: PathBuf,
    /// Paths that it names with `use` or in passing, from the root of its own crate.
    pub names: BTreeSet<ModulePath>,
    /// Names that it hands on, with where they come from.
    reexports: BTreeMap<String, ModulePath>,
    /// Modules of which it hands on everything.
    globs: Vec<ModulePath>,
}

/// A function and its lines, signature and braces included.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Function {
    /// Lines from the signature to the closing brace.
    pub lines: usize,
    /// File, line and name.
    pub place: String,
}

/// A crate.
#[derive(Debug, Default)]
pub struct Sources {
    /// Modules; the root has an empty path.
    pub modules: BTreeMap<ModulePath, Module>,
    /// Functions.
    pub functions: Vec<Function>,
}

impl Sources {
    /// Reads the crate in `folder`, from `src/lib.rs` on.
    pub fn read(folder: &Path) -> Self {
        let mut sources = Self::default();
        sources.read_file(folder, Path::new("src/lib.rs"), Path::new("src"), Vec::new());
        sources
    }

    /// Reads a file; its child modules lie in `children`.
    fn read_file(&mut self, folder: &Path, file: &Path, children: &Path, path: ModulePath) {
        let text = std::fs::read_to_string(folder.join(file))
            .unwrap_or_else(|error| panic!("{}: {error}", folder.join(file).display()));
        let syntax = syn::parse_file(&text).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        let File { items, .. } = syntax;
        self.read_items(folder, file, children, path, &items);
    }

    fn read_items(&mut self, folder: &Path, file: &Path, children: &Path, path: ModulePath, items: &[Item]) {
        let names: BTreeSet<String> = items
            .iter()
            .filter_map(|item| match item {
                Item::Mod(module) => Some(module.ident.to_string()),
                _ => None,
            })
            .collect();
        let module = Module { file: file.to_owned(), ..Module::default() };
        let mut reader = Reader { path: path.clone(), children: names, module, functions: Vec::new() };
        for item in items.iter().filter(|item| !is_for_tests(attributes(item))) {
            let Item::Mod(child) = item else {
                reader.visit_item(item);
                continue;
            };
            self.read_child(folder, file, children, &path, child);
        }
        self.functions.append(&mut reader.functions);
        self.modules.insert(path, reader.module);
    }

    fn read_child(
        &mut self,
        folder: &Path,
        file: &Path,
        children: &Path,
        parent: &[String],
        child: &ItemMod,
    ) {
        let name = child.ident.to_string();
        let path = [parent, std::slice::from_ref(&name)].concat();
        let below = children.join(&name);
        if let Some((_, items)) = &child.content {
            return self.read_items(folder, file, &below, path, items);
        }
        let [flat, nested] = [children.join(format!("{name}.rs")), below.join("mod.rs")];
        // What is generated has no source here.
        if let Some(file) = [flat, nested].into_iter().find(|file| folder.join(file).is_file()) {
            self.read_file(folder, &file, &below, path);
        }
    }

    /// The module in which a name is at home, through everything that hands it on.
    pub fn home(&self, name: &[String]) -> ModulePath {
        let mut at = Vec::new();
        for (depth, segment) in name.iter().enumerate() {
            let deeper = [at.clone(), vec![segment.clone()]].concat();
            if self.modules.contains_key(&deeper) {
                at = deeper;
                continue;
            }
            let rest = &name[depth + 1..];
            let Some(module) = self.modules.get(&at) else { break };
            if let Some(origin) = module.reexports.get(segment)
                && origin != name
            {
                return self.home(&[origin.as_slice(), rest].concat());
            }
            break;
        }
        at
    }
}

fn attributes(item: &Item) -> &[Attribute] {
    match item {
        Item::Const(i) => &i.attrs,
        Item::Enum(i) => &i.attrs,
        Item::Fn(i) => &i.attrs,
        Item::Impl(i) => &i.attrs,
        Item::Macro(i) => &i.attrs,
        Item::Mod(i) => &i.attrs,
        Item::Static(i) => &i.attrs,
        Item::Struct(i) => &i.attrs,
        Item::Trait(i) => &i.attrs,
        Item::Type(i) => &i.attrs,
        Item::Use(i) => &i.attrs,
        _ => &[],
    }
}

/// True if it carries `#[cfg(test)]` or `#[cfg(all(test, ...))]`.
fn is_for_tests(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|attribute| match &attribute.meta {
        Meta::List(list) => {
            let condition = list.tokens.to_string().replace(' ', "");
            list.path.is_ident("cfg") && (condition == "test" || condition.starts_with("all(test,"))
        }
        _ => false,
    })
}

/// Reads one module.
struct Reader {
    path: ModulePath,
    /// Names of its child modules.
    children: BTreeSet<String>,
    module: Module,
    functions: Vec<Function>,
}

impl Reader {
    /// Takes a path as it is written.
    fn name(&mut self, segments: &[String]) -> Option<ModulePath> {
        let (first, rest) = segments.split_first()?;
        let mut base = self.path.clone();
        let name = match first.as_str() {
            "crate" => rest.to_vec(),
            "self" => [&base, rest].concat(),
            "super" => {
                let ups = segments.iter().take_while(|segment| *segment == "super").count();
                base.truncate(base.len().checked_sub(ups)?);
                [&base, &segments[ups..]].concat()
            }
            child if self.children.contains(child) => [&base, segments].concat(),
            _ => return None,
        };
        self.module.names.insert(name.clone());
        Some(name)
    }

    fn use_tree(&mut self, tree: &UseTree, before: &[String], is_public: bool) {
        let with = |name: &dyn ToString| [before, &[name.to_string()]].concat();
        match tree {
            UseTree::Path(path) => self.use_tree(&path.tree, &with(&path.ident), is_public),
            UseTree::Group(group) => {
                group.items.iter().for_each(|tree| self.use_tree(tree, before, is_public));
            }
            UseTree::Name(name) if name.ident == "self" => self.import(before, None, is_public),
            UseTree::Name(name) => self.import(&with(&name.ident), Some(name.ident.to_string()), is_public),
            UseTree::Rename(rename) => {
                self.import(&with(&rename.ident), Some(rename.rename.to_string()), is_public);
            }
            UseTree::Glob(_) => {
                if let Some(name) = self.name(before)
                    && is_public
                {
                    self.module.globs.push(name);
                }
            }
        }
    }

    fn import(&mut self, segments: &[String], alias: Option<String>, is_public: bool) {
        if let (Some(name), Some(alias)) = (self.name(segments), alias)
            && is_public
        {
            self.module.reexports.insert(alias, name);
        }
    }

    fn measure(&mut self, name: &syn::Ident, from: proc_macro2::Span, block: &syn::Block) {
        let (first, last) = (from.start().line, block.span().end().line);
        let place = format!("{}:{first} {name}", self.module.file.display());
        self.functions.push(Function { lines: last + 1 - first, place });
    }
}

impl<'ast> Visit<'ast> for Reader {
    fn visit_item_use(&mut self, item: &'ast ItemUse) {
        let is_public = !matches!(item.vis, Visibility::Inherited);
        self.use_tree(&item.tree, &[], is_public);
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let segments: Vec<String> = path.segments.iter().map(|s| s.ident.to_string()).collect();
        let is_from_a_root = matches!(segments[0].as_str(), "crate" | "self" | "super");
        if segments.len() > 1 && is_from_a_root {
            self.name(&segments);
        }
        visit::visit_path(self, path);
    }

    /// Searches the tokens of a macro for `crate::`, as its content is not parsed.
    fn visit_macro(&mut self, item: &'ast syn::Macro) {
        let text = item.tokens.to_string().replace(' ', "");
        for (place, _) in text.match_indices("crate::") {
            let path = &text[place..];
            let end = path.find(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':'));
            let segments: Vec<String> =
                path[..end.unwrap_or(path.len())].split("::").map(str::to_owned).collect();
            self.name(&segments);
        }
        visit::visit_macro(self, item);
    }

    fn visit_item_mod(&mut self, item: &'ast ItemMod) {
        // Within a function or a module in line there is none of ours but tests.
        if !is_for_tests(&item.attrs) {
            visit::visit_item_mod(self, item);
        }
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        self.measure(&item.sig.ident, item.sig.span(), &item.block);
        visit::visit_item_fn(self, item);
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        self.measure(&item.sig.ident, item.sig.span(), &item.block);
        visit::visit_impl_item_fn(self, item);
    }

    fn visit_trait_item_fn(&mut self, item: &'ast syn::TraitItemFn) {
        if let Some(block) = &item.default {
            self.measure(&item.sig.ident, item.sig.span(), block);
        }
        visit::visit_trait_item_fn(self, item);
    }
}
