//! Names of projects: what is a crate or a package, a process and the first part of topics alike.

use std::path::Path;

use launch_cli::wrong_usage;

use crate::cli::Lang;

/// Longest name of a process in launch files.
const MAX_LEN: usize = 32;

/// Names that Gantry itself uses beside the project: processes of its launch file, first parts of
/// topics, crates and packages.
const OURS: &str = "\
    consumer_kit control drive ego free gantry numpy pytest record schema_bus schema_frames \
    schema_roads schema_types signal_hook simd test_kit tests view world";

/// Keywords of Rust, its own crates, and folders of its builds, which cargo refuses.
const RUST: &str = "\
    abstract alloc as async await become box break build const continue core crate deps do dyn \
    else enum examples extern false final fn for gen if impl in incremental let loop macro match \
    mod move mut override priv proc_macro pub ref return rustc self static std struct super test \
    trait true try type typeof union unsafe unsized use virtual where while yield";

/// Keywords of Python, and modules of its library (3.11), which a package beside them would hide.
const PYTHON: &str = "\
    abc aifc and antigravity argparse array as assert ast async asynchat asyncio asyncore atexit \
    audioop await base64 bdb binascii bisect break builtins bz2 calendar cgi cgitb chunk class \
    cmath cmd code codecs codeop collections colorsys compileall concurrent configparser conftest \
    contextlib contextvars continue copy copyreg crypt csv ctypes curses dataclasses datetime dbm \
    decimal def del difflib dis distutils doctest elif else email encodings ensurepip enum errno \
    except faulthandler fcntl filecmp fileinput finally fnmatch for fractions from ftplib \
    functools gc genericpath getopt getpass gettext glob global graphlib grp gzip hashlib heapq \
    hmac html http idlelib if imaplib imghdr imp import importlib in inspect io ipaddress is \
    itertools json keyword lambda lib2to3 linecache locale logging lzma mailbox mailcap marshal \
    math mimetypes mmap modulefinder msilib msvcrt multiprocessing netrc nis nntplib nonlocal not \
    nt ntpath nturl2path numbers opcode operator optparse or os ossaudiodev pass pathlib pdb \
    pickle pickletools pipes pkgutil platform plistlib poplib posix posixpath pprint profile \
    pstats pty pwd py_compile pyclbr pydoc pydoc_data pyexpat queue quopri raise random re \
    readline reprlib resource return rlcompleter runpy sched secrets select selectors shelve shlex \
    shutil signal site smtpd smtplib sndhdr socket socketserver spwd sqlite3 sre_compile \
    sre_constants sre_parse ssl stat statistics string stringprep struct subprocess sunau symtable \
    sys sysconfig syslog tabnanny tarfile telnetlib tempfile termios test textwrap this threading \
    time timeit tkinter token tokenize tomllib trace traceback tracemalloc try tty turtle \
    turtledemo types typing unicodedata unittest urllib uu uuid venv warnings wave weakref \
    webbrowser while winreg winsound with wsgiref xdrlib xml xmlrpc yield zipapp zipfile zipimport \
    zlib zoneinfo";

/// Keywords of C++20, what its library and the project's own files name, and targets of CMake.
const CPP: &str = "\
    alignas alignof and and_eq asm auto bitand bitor bool break case catch char class co_await \
    co_return co_yield compl concept const const_cast consteval constexpr constinit continue \
    decltype default delete detect_test do double dynamic_cast else enum explicit export extern \
    false float for friend goto if inline int long mutable namespace new noexcept not not_eq \
    nullptr operator or or_eq private protected public register reinterpret_cast requires return \
    run short signed simulator_test sizeof static static_assert static_cast std stop struct switch \
    template test this thread_local throw true try typedef typeid typename union unsigned using \
    virtual void volatile wchar_t while xor xor_eq";

/// The project's name, the last part of `path`.
///
/// # Errors
/// What is wrong with it, and what is allowed.
pub fn checked(path: &Path, lang: Lang) -> anyhow::Result<String> {
    let name = path
        .file_name()
        .map(|name| name.to_string_lossy().into_owned())
        .unwrap_or_default();
    let rest = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    let is_made_of = name.len() <= MAX_LEN
        && name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.chars().all(rest);
    if !is_made_of {
        let shown = if name.is_empty() {
            path.display().to_string()
        } else {
            name
        };
        return Err(wrong_usage(format!(
            "{shown:?} cannot be the name of a project: it must be 1 to {MAX_LEN} lower-case letters, digits or '_', a letter first"
        )));
    }
    let (language, taken) = match lang {
        Lang::Rust => ("Rust", RUST),
        Lang::Python => ("Python", PYTHON),
        Lang::Cpp => ("C++", CPP),
    };
    let is_in = |list: &str| list.split(' ').any(|word| word == name);
    let owner = if is_in(OURS) {
        "Gantry"
    } else if is_in(taken) {
        language
    } else {
        return Ok(name);
    };
    Err(wrong_usage(format!(
        "{name:?} cannot be the name of a project: {owner} uses it; choose another, e.g. my_{name}"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(path: &str, lang: Lang) -> String {
        let refused = checked(Path::new(path), lang);
        refused.expect_err("the name cannot be").to_string()
    }

    #[test]
    fn the_last_part_of_a_path_is_the_name() {
        for path in [
            "lane_net2",
            "../lane_net2",
            "/tmp/a b/lane_net2",
            "lane_net2/",
        ] {
            assert_eq!(checked(Path::new(path), Lang::Rust).unwrap(), "lane_net2");
        }
    }

    #[test]
    fn names_that_are_no_crate_package_process_and_topic_alike_are_refused() {
        for bad in [
            "Detector", "my-net", "2fast", "_x", "é", "a b", "..", "/", "",
        ] {
            let message = message(bad, Lang::Python);
            assert!(message.contains("lower-case letters"), "{bad}: {message}");
        }
        assert!(checked(Path::new(&"a".repeat(32)), Lang::Rust).is_ok());
        assert!(message(&"a".repeat(33), Lang::Rust).contains("1 to 32"));
    }

    #[test]
    fn names_in_use_are_refused_where_they_are_in_use() {
        assert!(message("simd", Lang::Rust).contains("Gantry uses it"));
        assert!(
            message("match", Lang::Rust).contains("Rust uses it; choose another, e.g. my_match")
        );
        assert!(checked(Path::new("match"), Lang::Python).is_ok());
        for taken in ["lambda", "traceback", "and", "zoneinfo"] {
            assert!(message(taken, Lang::Python).contains("Python uses it"));
        }
        assert!(checked(Path::new("lambda"), Lang::Rust).is_ok());
        for taken in ["namespace", "int", "simulator_test"] {
            assert!(message(taken, Lang::Cpp).contains("C++ uses it"));
        }
    }
}
