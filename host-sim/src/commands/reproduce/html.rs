//! The few elements that the page is made of.

use std::fmt::Write;

/// Text as HTML shows it.
pub(super) fn text(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            other => out.push(other),
        }
    }
    out
}

/// A table with a caption, HTML, and a line of heads; the first cell of each row heads it.
pub(super) fn table(caption: &str, heads: &[String], rows: &[Vec<String>]) -> String {
    let cells = |tag: &str, scope: &str, cells: &[String]| -> String {
        cells.iter().fold(String::new(), |mut out, cell| {
            // Writing to a string cannot fail.
            let _ = write!(out, "<{tag}{scope}>{}</{tag}>", text(cell));
            out
        })
    };
    let mut out = format!("<div class=\"wide\"><table><caption>{caption}</caption><thead><tr>");
    out += &cells("th", " scope=\"col\"", heads);
    out += "</tr></thead><tbody>\n";
    for row in rows {
        let (first, rest) = row.split_at(1.min(row.len()));
        out += "<tr>";
        out += &cells("th", " scope=\"row\"", first);
        out += &cells("td", "", rest);
        out += "</tr>\n";
    }
    out + "</tbody></table></div>\n"
}

/// A picture from the text of an SVG file, called what the first sentence of its caption, HTML, says.
pub(super) fn figure(svg: &str, caption: &str) -> String {
    let start = svg.find("<svg").unwrap_or(0);
    let name = caption.split('.').next().unwrap_or_default();
    format!(
        "<figure><div class=\"picture\" role=\"img\" aria-label=\"{}\">{}</div>\n<figcaption>{caption}</figcaption></figure>\n",
        name.replace('"', "&quot;"),
        &svg[start..]
    )
}

/// Links to files beside the page.
pub(super) fn links(files: &[&str]) -> String {
    let one = |file: &&str| format!("<a href=\"{0}\">{0}</a>", text(file));
    files.iter().map(one).collect::<Vec<_>>().join(", ")
}

/// `a, b and c`.
pub(super) fn list(items: &[String]) -> String {
    match items {
        [] => String::new(),
        [one] => one.clone(),
        [rest @ .., last] => format!("{} and {last}", rest.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_in_text_is_text() {
        assert_eq!(text("a < b & \"c\">"), "a &lt; b &amp; &quot;c&quot;&gt;");
        let table = table("t", &["x".into(), "<y>".into()], &[vec!["1".into(), "2&3".into()]]);
        assert!(table.contains("<th scope=\"col\">&lt;y&gt;</th>"), "{table}");
        assert!(table.contains("<th scope=\"row\">1</th><td>2&amp;3</td>"), "{table}");
    }

    #[test]
    fn lists_in_words() {
        let words = |count: usize| list(&["a", "b", "c"].map(String::from)[..count]);
        assert_eq!([0, 1, 2, 3].map(words), ["", "a", "a and b", "a, b and c"]);
    }
}
