//! The limits in `SECURITY.md` are those of the code.

use std::path::Path;

use test_tidy::repository;

const BEGIN: &str = "<!-- table: limits -->\n";
const END: &str = "<!-- /table -->";

/// The whole number that an expression of literals means, and whether it is a time in seconds.
fn value(expression: &syn::Expr) -> Option<(u128, bool)> {
    match expression {
        syn::Expr::Lit(literal) => match &literal.lit {
            syn::Lit::Int(number) => Some((number.base10_parse().ok()?, false)),
            _ => None,
        },
        syn::Expr::Paren(inner) => value(&inner.expr),
        syn::Expr::Binary(both) => {
            let ((a, _), (b, _)) = (value(&both.left)?, value(&both.right)?);
            let result = match both.op {
                syn::BinOp::Shl(_) => a << b,
                syn::BinOp::Mul(_) => a * b,
                syn::BinOp::Add(_) => a + b,
                syn::BinOp::Sub(_) => a - b,
                _ => return None,
            };
            Some((result, false))
        }
        syn::Expr::Call(call) => {
            let syn::Expr::Path(function) = &*call.func else {
                return None;
            };
            let is_secs = function.path.segments.last()?.ident == "from_secs";
            let (number, _) = value(call.args.first()?)?;
            is_secs.then_some((number, true))
        }
        _ => None,
    }
}

/// The constant as people write it: `16 MiB`, `30 s`, `16 384`.
fn text_of(name: &str, file: &Path) -> String {
    let place = format!("{name} in {}", file.display());
    let source = std::fs::read_to_string(file).unwrap_or_else(|error| panic!("{place}: {error}"));
    let parsed = syn::parse_file(&source).unwrap_or_else(|error| panic!("{place}: {error}"));
    let found = parsed.items.iter().find_map(|item| match item {
        syn::Item::Const(constant) if constant.ident == name => Some(&constant.expr),
        _ => None,
    });
    let expression = found.unwrap_or_else(|| panic!("there is no constant {place}"));
    let (number, is_time) =
        value(expression).unwrap_or_else(|| panic!("{place} is no number or time"));
    if is_time {
        return format!("{number} s");
    }
    if name.ends_with("BYTES") {
        let units = [(30, "GiB"), (20, "MiB"), (10, "KiB")];
        let unit = units
            .iter()
            .find(|(bits, _)| number >= 1 << bits && number % (1 << bits) == 0);
        return match unit {
            Some((bits, unit)) => format!("{} {unit}", number >> bits),
            None => format!("{number} bytes"),
        };
    }
    if name.ends_with("NANOS") && number.is_multiple_of(86_400_000_000_000) {
        return format!("{} days", number / 86_400_000_000_000);
    }
    let digits = number.to_string();
    let grouped: Vec<&str> = digits
        .as_bytes()
        .rchunks(3)
        .rev()
        .map(|group| std::str::from_utf8(group).expect("digits are ASCII"))
        .collect();
    grouped.join(" ")
}

#[test]
fn the_table_of_limits_is_that_of_the_code() {
    let page = repository().join("SECURITY.md");
    let text = std::fs::read_to_string(&page).expect("SECURITY.md can be read");
    let (before, rest) = text.split_once(BEGIN).expect("the table has a beginning");
    let (table, after) = rest.split_once(END).expect("the table has an end");
    let (mut written, mut wrong) = (String::new(), Vec::new());
    for line in table.lines() {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        let quoted: Vec<&str> = line.split('`').skip(1).step_by(2).collect();
        let [name, file] = quoted[..] else {
            written += &format!("{line}\n");
            continue;
        };
        let is = text_of(name, &repository().join(file));
        if cells[1] != is {
            wrong.push(format!(
                "{name} is {is}, but SECURITY.md says {:?}",
                cells[1]
            ));
        }
        written += &format!("| {} | {is} | `{name}` in `{file}` |\n", cells[0]);
    }
    if std::env::var_os("GANTRY_BLESS").is_some() {
        std::fs::write(&page, format!("{before}{BEGIN}{written}{END}{after}"))
            .expect("SECURITY.md can be written");
        return;
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
