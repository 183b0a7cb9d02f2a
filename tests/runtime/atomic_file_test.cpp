#include "runtime/atomic_file.h"

#include <doctest/doctest.h>
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
    CHECK(e.kind() == ErrorKind::kUsage);
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
