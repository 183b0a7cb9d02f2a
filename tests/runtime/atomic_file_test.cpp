#include "runtime/atomic_file.h"

#include <doctest/doctest.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <span>
#include <string>

#include "runtime/error.h"
#include "tests/temporary_folder.h"

using namespace slide;

namespace {

std::string text_of(const std::string& path) {
  const std::vector<std::byte> bytes = bytes_of_file(path);
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

}  // namespace

TEST_CASE("an atomic file has its name only after commit") {
  const TemporaryFolder folder;
  const std::string path = folder.file("a.txt");
  {
    AtomicFile file(path);
    file.write("one ");
    file.write("two");
    CHECK(!std::filesystem::exists(path));
    CHECK(folder.entries() == 1);
    file.write_at(0, std::as_bytes(std::span("ONE", 3)));
    CHECK(file.size() == 7);
    file.commit();
    CHECK_THROWS_AS(file.write("more"), Error);
  }
  CHECK(text_of(path) == "ONE two");
  CHECK(folder.entries() == 1);
}

TEST_CASE("an atomic file that is not committed leaves nothing behind and keeps the older file") {
  const TemporaryFolder folder;
  const std::string path = folder.file("a.txt");
  write_bytes(path, std::as_bytes(std::span("older", 5)));
  ::chmod(path.c_str(), 0640);
  {
    AtomicFile file(path);
    file.write("newer");
  }
  CHECK(text_of(path) == "older");
  CHECK(folder.entries() == 1);
  AtomicFile file(path);
  file.write("newer");
  file.commit();
  CHECK(text_of(path) == "newer");
  struct stat status {};
  REQUIRE(::stat(path.c_str(), &status) == 0);
  CHECK((status.st_mode & 0777) == 0640);
}

TEST_CASE("an atomic file follows a symbolic link and stays a link") {
  const TemporaryFolder folder;
  write_bytes(folder.file("real"), std::as_bytes(std::span("older", 5)));
  std::filesystem::create_symlink("real", folder.file("link"));
  AtomicFile file(folder.file("link"));
  file.write("newer");
  file.commit();
  CHECK(std::filesystem::is_symlink(folder.file("link")));
  CHECK(text_of(folder.file("real")) == "newer");
}

TEST_CASE("an atomic file refuses what is no file, and says why") {
  const TemporaryFolder folder;
  CHECK_THROWS_WITH_AS(AtomicFile(folder.path().string()), doctest::Contains("Is a directory"), Error);
  CHECK_THROWS_WITH_AS(AtomicFile("/dev/null"), doctest::Contains("device or a pipe"), Error);
  CHECK_THROWS_WITH_AS(AtomicFile(folder.file("no/such/folder")), doctest::Contains("No such file"), Error);
  CHECK_THROWS_AS(AtomicFile(""), Error);
  try {
    AtomicFile file(folder.file("no/x"));
    FAIL("accepted");
  } catch (const Error& e) {
    CHECK(e.kind() == ErrorKind::kOutput);
    CHECK(std::string(e.what()).find(folder.file("no/x")) != std::string::npos);
  }
  CHECK(folder.entries() == 0);
}

TEST_CASE("two paths are one file whatever their spelling and the links between") {
  const TemporaryFolder folder;
  write_bytes(folder.file("a"), {});
  write_bytes(folder.file("b"), {});
  std::filesystem::create_symlink(folder.file("a"), folder.file("symbolic"));
  std::filesystem::create_hard_link(folder.file("a"), folder.file("hard"));
  for (const std::string name : {"a", "./a", "symbolic", "hard"})
    CHECK(same_file(folder.file("a"), folder.file(name)));
  CHECK_FALSE(same_file(folder.file("a"), folder.file("b")));
  CHECK_FALSE(same_file(folder.file("none"), folder.file("none")));
}

TEST_CASE("unfinished files are removed at once when asked, finished ones are not") {
  const TemporaryFolder folder;
  AtomicFile done(folder.file("done"));
  done.commit();
  AtomicFile a(folder.file("a"));
  AtomicFile b(folder.file("b"));
  CHECK(folder.entries() == 3);
  remove_unfinished_files();
  CHECK(folder.entries() == 1);
}

TEST_CASE("an interrupted process leaves no unfinished file and still dies of the signal") {
  const TemporaryFolder folder;
  for (const int signal : {SIGINT, SIGTERM}) {
    const pid_t child = ::fork();
    REQUIRE(child >= 0);
    if (child == 0) {
      std::signal(signal, SIG_DFL);
      remove_unfinished_files_on_signals();
      AtomicFile file(folder.file("a"));
      file.write("half");
      ::raise(signal);
      ::_exit(0);
    }
    int status = 0;
    REQUIRE(::waitpid(child, &status, 0) == child);
    CHECK(WIFSIGNALED(status));
    CHECK(WTERMSIG(status) == signal);
    CHECK(folder.entries() == 0);
  }
}

TEST_CASE("what killed processes left behind is removed, and nothing else") {
  const TemporaryFolder folder;
  const pid_t child = ::fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    AtomicFile file(folder.file("a.gif"));
    file.write("half");
    ::kill(::getpid(), SIGKILL);
  }
  int status = 0;
  REQUIRE(::waitpid(child, &status, 0) == child);
  REQUIRE(WIFSIGNALED(status));
  REQUIRE(folder.entries() == 1);
  const std::string dead = std::to_string(child);
  const std::string alive = std::to_string(::getppid());
  const std::vector<std::string> kept = {
      "a.part-" + alive + "-0", "a.part-" + dead + "-", "a.part-" + dead,          "a.part-x-0",
      "a.part-" + dead + "-0x", ".part-" + dead + "-0", "held.part-" + dead + "-0"};
  for (const std::string& name : kept) write_bytes(folder.file(name), std::as_bytes(std::span("x", 1)));
  std::filesystem::create_symlink(kept[0], folder.file("link.part-" + dead + "-0"));
  const int held = ::open(folder.file(kept.back()).c_str(), O_RDONLY);
  REQUIRE(held >= 0);
  REQUIRE(::flock(held, LOCK_EX | LOCK_NB) == 0);
  AtomicFile file(folder.file("b.gif"));
  file.commit();
  for (const std::string& name : kept) CHECK_MESSAGE(std::filesystem::exists(folder.file(name)), name);
  CHECK(std::filesystem::is_symlink(folder.file("link.part-" + dead + "-0")));
  CHECK(folder.entries() == static_cast<std::ptrdiff_t>(kept.size()) + 2);
  ::close(held);
}

TEST_CASE("a disk that is full is an output that cannot be written, and nothing stays") {
  const TemporaryFolder folder;
  rlimit before{};
  REQUIRE(::getrlimit(RLIMIT_FSIZE, &before) == 0);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{1000, before.rlim_max};
  REQUIRE(::setrlimit(RLIMIT_FSIZE, &small) == 0);
  ErrorKind kind = ErrorKind::kInternal;
  try {
    AtomicFile file(folder.file("a"));
    file.write(std::string(2000, 'x'));
    file.commit();
  } catch (const Error& e) {
    kind = e.kind();
  }
  ::setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, old_handler);
  CHECK(kind == ErrorKind::kOutput);
  CHECK(exit_code(kind) == 7);
  CHECK(folder.entries() == 0);
}
