#include "render/child_process.h"

#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <sstream>
#include <system_error>

#include "runtime/error.h"

namespace slide {
namespace {

/// posix_spawn's two option objects, released together.
struct SpawnOptions {
  posix_spawn_file_actions_t actions{};
  posix_spawnattr_t attributes{};

  SpawnOptions() {
    posix_spawn_file_actions_init(&actions);
    posix_spawnattr_init(&attributes);
  }
  ~SpawnOptions() {
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
  }
  SpawnOptions(const SpawnOptions&) = delete;
  SpawnOptions& operator=(const SpawnOptions&) = delete;
};

/// The first executable file of that name in the folders of PATH, empty if there is none.
std::string find_on_path(const std::string& program) {
  const char* path = std::getenv("PATH");
  std::istringstream folders(path != nullptr ? path : "/usr/local/bin:/usr/bin:/bin");
  for (std::string folder; std::getline(folders, folder, ':');) {
    std::string candidate = (folder.empty() ? "." : folder) + "/" + program;
    std::error_code code;
    if (std::filesystem::is_regular_file(candidate, code) && ::access(candidate.c_str(), X_OK) == 0)
      return candidate;
  }
  return "";
}

int wait_for(pid_t pid) {
  int status = 0;
  while (::waitpid(pid, &status, 0) < 0 && errno == EINTR) {
  }
  return status;
}

}  // namespace

ChildProcess::ChildProcess(const std::vector<std::string>& arguments, const std::string& remedy)
    : program_(arguments.at(0)) {
  const std::string executable = find_on_path(program_);
  if (executable.empty()) throw Error(ErrorKind::kUsage, program_ + " was not found on PATH", remedy);
  // A socket, not a pipe: send() can be told to raise no SIGPIPE.
  std::array<int, 2> ends{};
  output_.reset(std::tmpfile());
  if (!output_ || ::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) {
    throw Error(kind_of_failure(errno, ErrorKind::kOutput),
                "cannot start " + program_ + ": " + std::generic_category().message(errno));
  }
  input_ = ends[0];
  SpawnOptions options;
  posix_spawn_file_actions_adddup2(&options.actions, ends[1], STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&options.actions, ::fileno(output_.get()), STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&options.actions, ::fileno(output_.get()), STDERR_FILENO);
  sigset_t defaults;
  sigemptyset(&defaults);
  sigaddset(&defaults, SIGPIPE);
  posix_spawnattr_setsigdefault(&options.attributes, &defaults);
  posix_spawnattr_setflags(&options.attributes, POSIX_SPAWN_SETSIGDEF);
  std::vector<char*> argv;
  argv.reserve(arguments.size() + 1);
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  const int code =
      ::posix_spawn(&pid_, executable.c_str(), &options.actions, &options.attributes, argv.data(), environ);
  ::close(ends[1]);
  if (code == 0) return;
  pid_ = -1;
  ::close(input_);
  throw Error(kind_of_failure(code, ErrorKind::kOutput),
              "cannot start " + executable + ": " + std::generic_category().message(code), remedy);
}

ChildProcess::~ChildProcess() {
  if (input_ >= 0) ::close(input_);
  if (pid_ < 0) return;
  ::kill(pid_, SIGKILL);
  wait_for(pid_);
}

bool ChildProcess::write(std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::send(input_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(n));
  }
  return true;
}

void ChildProcess::wait() {
  ::close(input_);
  input_ = -1;
  const int status = wait_for(pid_);
  pid_ = -1;
  const std::string said = printed();
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0 && said.empty()) return;
  const std::string how = WIFSIGNALED(status) ? "signal " + std::to_string(WTERMSIG(status))
                                              : "exit status " + std::to_string(WEXITSTATUS(status));
  throw Error(ErrorKind::kOutput,
              program_ + " failed (" + how + "): " + (said.empty() ? "it printed nothing" : said));
}

/// The last few hundred characters, on one line.
std::string ChildProcess::printed() const {
  constexpr long kLongest = 600;
  std::fseek(output_.get(), 0, SEEK_END);
  const long length = std::ftell(output_.get());
  std::fseek(output_.get(), std::max(0L, length - kLongest), SEEK_SET);
  std::array<char, kLongest> text{};
  const std::size_t n = std::fread(text.data(), 1, text.size(), output_.get());
  std::string line(text.data(), n);
  std::replace(line.begin(), line.end(), '\n', ' ');
  while (!line.empty() && line.back() == ' ') line.pop_back();
  return line;
}

}  // namespace slide
