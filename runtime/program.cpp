#include "runtime/program.h"

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <exception>
#include <iostream>
#include <new>
#include <system_error>

#include "runtime/atomic_file.h"

namespace slide {
namespace {

void require_printed() {
  errno = 0;
  std::cout.flush();
  const bool flushed = std::fflush(stdout) == 0;
  const int code = errno;
  if (flushed && std::ferror(stdout) == 0 && std::cout.good()) return;
  throw Error(ErrorKind::kOutput, "cannot write to standard output" +
                                      (code != 0 ? ": " + std::generic_category().message(code) : ""));
}

int report(const char* name) noexcept {
  try {
    const Failure failure = current_failure();
    std::fprintf(stderr, "%s: %s\n", name, failure.message.c_str());
    return exit_code(failure.kind);
  } catch (...) {  // there was no memory for the message
    std::fprintf(stderr, "%s: memory ran out\n", name);
    return exit_code(ErrorKind::kOutOfMemory);
  }
}

}  // namespace

Failure current_failure() {
  try {
    throw;
  } catch (const Error& e) {
    return {e.kind(), e.what()};
  } catch (const std::bad_alloc&) {
    return {ErrorKind::kOutOfMemory, "memory ran out"};
  } catch (const std::system_error& e) {
    const std::error_condition reason = e.code().default_error_condition();
    if (reason == std::errc::not_enough_memory || reason == std::errc::resource_unavailable_try_again)
      return {ErrorKind::kOutOfMemory, std::string("memory or threads ran out: ") + e.what()};
    return {ErrorKind::kInternal, std::string("internal error: ") + e.what()};
  } catch (const std::exception& e) {
    return {ErrorKind::kInternal, std::string("internal error: ") + e.what()};
  } catch (...) {
    return {ErrorKind::kInternal, "internal error of an unknown kind"};
  }
}

int run_program(const char* name, const std::function<int()>& run) noexcept {
  remove_unfinished_files_on_signals();
  static_cast<void>(std::signal(SIGPIPE, SIG_IGN));  // writing fails instead, and is reported
  int code = 0;
  try {
    code = run();
  } catch (...) {
    code = report(name);
  }
  try {
    require_printed();
  } catch (...) {
    const int failed = report(name);
    if (code == 0) code = failed;
  }
  return code;
}

}  // namespace slide
