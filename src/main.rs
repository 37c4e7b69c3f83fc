//! Parse, call, exit code; nothing else.

fn main() -> std::process::ExitCode {
    inkling::cli::run(std::env::args_os()).into()
}
