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
/// prints kept for the message if it fails. That it may stop reading at any time raises no signal here.
class ChildProcess {
 public:
  /// Starts arguments[0], looked up on PATH.
  /// @throws Error(kUsage) "PROGRAM was not found on PATH" or the system's reason, with `remedy`
  ChildProcess(const std::vector<std::string>& arguments, const std::string& remedy);
  /// Ends the program if wait() has not seen its end.
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  /// False if the program no longer reads; wait() says why.
  [[nodiscard]] bool write(std::span<const std::byte> bytes);
  /// Ends its input and waits. @throws Error(kUsage) with what it printed unless it ends with status 0
  void wait();

 private:
  [[nodiscard]] std::string printed() const;

  std::string program_;
  pid_t pid_ = -1;
  int input_ = -1;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> output_{nullptr, &std::fclose};
};

}  // namespace slide
