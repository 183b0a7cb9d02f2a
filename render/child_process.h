#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdio>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace slide {

/// A program that reads from us: started without a shell, its standard input fed by write(), whatever it
/// prints kept: it must print nothing when all is well. That it may stop reading at any time raises no signal
/// here.
class ChildProcess {
 public:
  /// Starts arguments[0], looked up on PATH.
  /// @throws Error(kUsage) "PROGRAM was not found on PATH", with `remedy`; Error(kOutput) with the system's
  /// reason if it cannot be started
  ChildProcess(const std::vector<std::string>& arguments, const std::string& remedy);
  /// Ends the program if wait() has not seen its end.
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  /// False if the program no longer reads; wait() says why.
  [[nodiscard]] bool write(std::span<const std::byte> bytes);
  /// Ends its input and waits. @throws Error(kOutput) with what it printed unless it printed nothing and
  /// ended with status 0: ffmpeg ends so after a write that failed, having complained
  void wait();

 private:
  [[nodiscard]] std::string printed() const;

  std::string program_;
  pid_t pid_ = -1;
  int input_ = -1;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> output_{nullptr, &std::fclose};
};

}  // namespace slide
