#pragma once

namespace slide {

/// While it lives, parallel loops that start on this thread use `count` threads, whatever set_thread_count()
/// says; 0 or less: as without it. Scopes nest; each ends on the thread on which it began.
class ThreadScope {
 public:
  explicit ThreadScope(int count) noexcept;
  ~ThreadScope();
  ThreadScope(const ThreadScope&) = delete;
  ThreadScope& operator=(const ThreadScope&) = delete;

 private:
  int before_;
};

}  // namespace slide
