//! The program's entry: hands the arguments to [`inkling::cli`], and returns its exit code.

fn main() -> std::process::ExitCode {
    inkling::cli::run(std::env::args_os()).into()
}
