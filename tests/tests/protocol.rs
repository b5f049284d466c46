//! The page on the link lists the messages that the source has, in its words.
//!
//! `SPLASH_ACCEPT=1` writes the lists anew.

use quote::ToTokens;
use std::fmt::Write;
use std::path::Path;
use syn::{Attribute, Expr, Fields, Item, Lit, Meta};

/// Where the lists begin in the page.
const START: &str = "<!-- The lists below are made from firmware/src/link/message.rs. -->\n";

/// The first paragraph of an item's documentation, on one line, without links.
fn first_paragraph(attributes: &[Attribute]) -> String {
    let lines = attributes.iter().filter_map(|attribute| match &attribute.meta {
        Meta::NameValue(pair) if pair.path.is_ident("doc") => match &pair.value {
            Expr::Lit(literal) => match &literal.lit {
                Lit::Str(text) => Some(text.value().trim().to_owned()),
                _ => None,
            },
            _ => None,
        },
        _ => None,
    });
    let text: Vec<String> = lines.take_while(|line| !line.is_empty()).collect();
    let text = text.join(" ").replace("[`", "`").replace("`]", "`").replace("crate::", "");
    text.replace("Response::", "").replace("Request::", "")
}

fn name_of(kind: &syn::Type) -> String {
    kind.to_token_stream().to_string().replace(' ', "").replace("heapless::", "").replace(',', ", ")
}

/// A table of the variants of an enum of the source.
fn table(source: &syn::File, name: &str) -> String {
    let found = source.items.iter().find_map(|item| match item {
        Item::Enum(found) if found.ident == name => Some(found),
        _ => None,
    });
    let mut lines = format!("\n## {name}\n\n| tag | name | fields | what |\n|---|---|---|---|\n");
    for (tag, variant) in found.expect("an enum of that name").variants.iter().enumerate() {
        let fields: Vec<String> = match &variant.fields {
            Fields::Unit => Vec::new(),
            Fields::Unnamed(fields) => {
                fields.unnamed.iter().map(|field| format!("`{}`", name_of(&field.ty))).collect()
            }
            Fields::Named(fields) => fields
                .named
                .iter()
                .map(|field| {
                    let name = field.ident.as_ref().map(ToString::to_string).unwrap_or_default();
                    format!("`{name}: {}`", name_of(&field.ty))
                })
                .collect(),
        };
        let what = first_paragraph(&variant.attrs);
        assert!(!what.is_empty(), "{name}::{}", variant.ident);
        let fields = fields.join(", ");
        writeln!(lines, "| {tag} | {} | {fields} | {what} |", variant.ident).expect("memory");
    }
    lines
}

#[test]
fn the_page_lists_the_messages() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware/src/link");
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).expect(name);
    let source = syn::parse_file(&read("message.rs")).expect("Rust");
    let page = read("protocol.md");
    let (words, lists) = page.split_once(START).expect("the place of the lists");
    let expected = ["Request", "Response", "Reason"].map(|name| table(&source, name)).concat();
    if std::env::var_os("SPLASH_ACCEPT").is_some() {
        let page = format!("{words}{START}{expected}");
        std::fs::write(folder.join("protocol.md"), page).expect("protocol.md");
    } else {
        assert!(lists == expected, "SPLASH_ACCEPT=1 writes the lists of protocol.md anew");
    }
}

/// What the page says of sizes is what the library has.
#[test]
fn the_page_has_the_right_numbers() {
    use splash_firmware::link::{LIST, MESSAGE, PIECE, VERSION, WIRE};
    let page = include_str!("../../firmware/src/link/protocol.md");
    for (what, number) in [
        ("version", usize::from(VERSION)),
        ("longest message", MESSAGE),
        ("longest frame", WIRE),
        ("piece of a list", LIST),
        ("piece of an image", PIECE),
    ] {
        let row = format!("| {what} | {number} |");
        assert!(page.contains(&row), "{row}");
    }
}
