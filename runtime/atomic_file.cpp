#include "runtime/atomic_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <set>
#include <system_error>

#include "runtime/error.h"

namespace slide {
namespace {

Error failed(const std::string& what, const std::string& path, int code) {
  return Error(kind_of_failure(code, ErrorKind::kOutput),
               "cannot " + what + " " + path + ": " + std::generic_category().message(code));
}

// The names a signal handler may have to remove. A slot is free, being filled, or holds a name; a handler
// looks only at the last kind, so it never sees half a name.
struct Slot {
  enum State : int { kFree, kFilling, kNamed };
  std::atomic<int> state{kFree};
  std::array<char, 4096> name{};
};
static_assert(std::atomic<int>::is_always_lock_free, "a signal handler reads it");

std::array<Slot, 64> slots;

int register_name(const std::string& name) noexcept {
  if (name.size() >= slots[0].name.size()) return -1;
  for (std::size_t i = 0; i < slots.size(); ++i) {
    int expected = Slot::kFree;
    if (!slots[i].state.compare_exchange_strong(expected, Slot::kFilling)) continue;
    std::memcpy(slots[i].name.data(), name.c_str(), name.size() + 1);
    slots[i].state.store(Slot::kNamed);
    return static_cast<int>(i);
  }
  return -1;
}

void release_name(int slot) noexcept {
  if (slot >= 0) slots[static_cast<std::size_t>(slot)].state.store(Slot::kFree);
}

/// The path with symbolic links followed, absolute, so that neither a chdir nor the rename changes what it
/// means.
std::string resolved(const std::string& path) {
  std::error_code code;
  const std::filesystem::path full =
      std::filesystem::weakly_canonical(std::filesystem::absolute(path, code), code);
  return code ? path : full.string();
}

/// The permissions of an older regular file, or those that a new file gets. Refuses anything else of that
/// name.
mode_t permissions_for(const std::string& path) {
  struct stat older {};
  if (::stat(path.c_str(), &older) != 0) return 0;
  if (S_ISDIR(older.st_mode)) throw failed("write", path, EISDIR);
  if (!S_ISREG(older.st_mode))
    throw Error(ErrorKind::kOutput, "cannot write " + path + ": it is a device or a pipe, not a file");
  return older.st_mode & 0777u;
}

/// Whether a file name ends as temporary names do, in the number of a process that has ended.
bool left_behind(const std::string& name) {
  constexpr std::string_view kMark = ".part-";
  const std::size_t at = name.rfind(kMark);
  if (at == std::string::npos || at == 0) return false;
  const char* const end = name.data() + name.size();
  pid_t process = 0;
  const auto [dash, error] = std::from_chars(name.data() + at + kMark.size(), end, process);
  if (error != std::errc{} || dash == end || *dash != '-' || dash + 1 == end) return false;
  if (!std::all_of(dash + 1, end, [](char c) { return c >= '0' && c <= '9'; })) return false;
  return process > 1 && ::kill(process, 0) != 0 && errno == ESRCH;
}

/// Removes a temporary file that nobody holds open; a process elsewhere (another machine or container, whose
/// process numbers are others) holds it locked.
void remove_unlocked(const std::filesystem::path& path) noexcept {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (descriptor < 0) return;
  struct stat status {};
  if (::fstat(descriptor, &status) == 0 && S_ISREG(status.st_mode) &&
      ::flock(descriptor, LOCK_EX | LOCK_NB) == 0)
    ::unlink(path.c_str());
  ::close(descriptor);
}

/// Once for each folder in a process.
void remove_left_behind(const std::filesystem::path& folder) {
  static std::mutex mutex;
  static std::set<std::string> cleaned;
  {
    const std::lock_guard<std::mutex> lock(mutex);
    if (!cleaned.insert(folder.string()).second) return;
  }
  std::error_code code;
  for (std::filesystem::directory_iterator entry(folder, code), end; !code && entry != end;
       entry.increment(code))
    if (left_behind(entry->path().filename().string())) remove_unlocked(entry->path());
}

}  // namespace

AtomicFile::AtomicFile(const std::string& path) : path_(path) {
  static std::atomic<unsigned> counter{0};
  if (path.empty()) throw Error(ErrorKind::kUsage, "cannot write a file without a name");
  const std::string target = resolved(path);
  const mode_t permissions = permissions_for(target);
  remove_left_behind(std::filesystem::path(target).parent_path());
  do {
    temporary_ = target + ".part-" + std::to_string(::getpid()) + "-" + std::to_string(counter++);
    slot_ = register_name(temporary_);  // before it exists, so that no signal finds it unknown
    descriptor_ = ::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (descriptor_ >= 0) break;
    release_name(slot_);
  } while (errno == EEXIST);
  if (descriptor_ < 0) throw failed("create", path, errno);
  static_cast<void>(::flock(descriptor_, LOCK_EX | LOCK_NB));
  if (permissions != 0) static_cast<void>(::fchmod(descriptor_, permissions));
}

AtomicFile::~AtomicFile() { discard(); }

void AtomicFile::discard() noexcept {
  if (descriptor_ < 0) return;
  ::close(descriptor_);
  descriptor_ = -1;
  ::unlink(temporary_.c_str());
  release_name(slot_);
}

void AtomicFile::write(std::span<const std::byte> bytes) {
  write_at(size_, bytes);
  size_ += bytes.size();
}

void AtomicFile::write_at(std::uint64_t offset, std::span<const std::byte> bytes) {
  if (descriptor_ < 0) throw Error(ErrorKind::kInternal, path_ + " was written after it was finished");
  while (!bytes.empty()) {
    const ssize_t n = ::pwrite(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) throw failed("write", path_, n < 0 ? errno : EIO);
    bytes = bytes.subspan(static_cast<std::size_t>(n));
    offset += static_cast<std::uint64_t>(n);
  }
}

void AtomicFile::commit() {
  if (descriptor_ < 0) throw Error(ErrorKind::kInternal, path_ + " was finished twice");
  if (::fsync(descriptor_) != 0 && errno != EINVAL) throw failed("write", path_, errno);
  const std::string target = temporary_.substr(0, temporary_.rfind(".part-"));
  if (::rename(temporary_.c_str(), target.c_str()) != 0) throw failed("create", path_, errno);
  const int closed = ::close(descriptor_);
  descriptor_ = -1;
  release_name(slot_);
  if (closed != 0) throw failed("write", path_, errno);
  // The new name is on the disk once its folder is; if the file system cannot do that, the file is still
  // complete.
  const int folder =
      ::open(std::filesystem::path(target).parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder < 0) return;
  static_cast<void>(::fsync(folder));
  ::close(folder);
}

bool same_file(const std::string& a, const std::string& b) noexcept {
  struct stat first {};
  struct stat second {};
  return ::stat(a.c_str(), &first) == 0 && ::stat(b.c_str(), &second) == 0 && first.st_dev == second.st_dev &&
         first.st_ino == second.st_ino;
}

void remove_unfinished_files() noexcept {
  for (const Slot& slot : slots)
    if (slot.state.load() == Slot::kNamed) ::unlink(slot.name.data());
}

namespace {

void remove_and_end(int signal) {
  remove_unfinished_files();
  ::raise(signal);  // SA_RESETHAND has restored the default, which runs when this handler returns
}

}  // namespace

void remove_unfinished_files_on_signals() noexcept {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    struct sigaction action {};
    if (::sigaction(signal, nullptr, &action) == 0 && action.sa_handler == SIG_IGN) continue;
    action = {};
    action.sa_handler = remove_and_end;
    action.sa_flags = static_cast<int>(SA_RESETHAND);
    sigemptyset(&action.sa_mask);
    ::sigaction(signal, &action, nullptr);
  }
}

}  // namespace slide
