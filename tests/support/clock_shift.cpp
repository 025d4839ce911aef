// To be preloaded (LD_PRELOAD): a wall clock that somebody sets while the process runs. The file
// named by ITN_CLOCK_SHIFT_FILE holds the seconds, of either sign, by which the time of day is off;
// it may appear and change at any time and is read again every 10 ms. A process that has told a
// shifted time says so by a file beside it, ITN_CLOCK_SHIFT_FILE.PID.SECONDS.
//
// Shifted are the calls below, which ask for CLOCK_REALTIME or wait until a time by it; what makes
// such system calls by itself sees the machine's time. The monotonic clock is not shifted, as when
// a clock is really set.
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>
#include <cerrno>

#include <array>
#include <atomic>
#include <cstdint>

namespace {

constexpr int64_t kLookAgainNanoseconds = 10'000'000;

// Whatever the loader would have called without this library.
template <typename Function>
Function next(const char* name) {
  return reinterpret_cast<Function>(::dlsym(RTLD_NEXT, name));
}

int real_clock_gettime(clockid_t clock, timespec* time) {
  static const auto function = next<int (*)(clockid_t, timespec*)>("clock_gettime");
  return function(clock, time);
}

int64_t read_shift() {
  const char* path = ::getenv("ITN_CLOCK_SHIFT_FILE");
  const int fd = path == nullptr ? -1 : ::open(path, O_RDONLY | O_CLOEXEC);
  if (fd < 0) return 0;
  std::array<char, 32> text{};
  const bool any = ::read(fd, text.data(), text.size() - 1) > 0;
  ::close(fd);
  return any ? ::strtoll(text.data(), nullptr, 10) : 0;
}

void say_that_it_is(int64_t shift) {
  std::array<char, 4096> path{};
  ::snprintf(path.data(), path.size(), "%s.%d.%lld", ::getenv("ITN_CLOCK_SHIFT_FILE"),
             static_cast<int>(::getpid()), static_cast<long long>(shift));
  const int fd = ::open(path.data(), O_WRONLY | O_CREAT | O_CLOEXEC, 0666);
  if (fd >= 0) ::close(fd);
}

// In seconds.
int64_t shift() {
  static std::atomic<int64_t> current = 0, looked = 0;
  timespec time{};
  real_clock_gettime(CLOCK_MONOTONIC, &time);
  const int64_t now = int64_t{time.tv_sec} * 1'000'000'000 + time.tv_nsec;
  int64_t before = looked;
  if (now - before >= kLookAgainNanoseconds && looked.compare_exchange_strong(before, now)) {
    const int error = errno;
    const int64_t read = read_shift();
    if (current.exchange(read) != read) say_that_it_is(read);
    errno = error;
  }
  return current;
}

bool is_wall(clockid_t clock) {
  return clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE;
}

// A wait until a wall time ends when the clock says so, however it is set meanwhile: waits a little
// by the real clock and looks again. Waits may end early (as spurious wake-ups do) but for time.
template <typename Wait>
int wait_until(const timespec* until, const Wait& wait) {
  timespec now{};
  real_clock_gettime(CLOCK_REALTIME, &now);
  timespec soon = now;
  soon.tv_nsec += kLookAgainNanoseconds;
  if (soon.tv_nsec >= 1'000'000'000) {
    soon.tv_nsec -= 1'000'000'000;
    ++soon.tv_sec;
  }
  timespec real = *until;
  real.tv_sec -= shift();
  const bool is_soon =
      real.tv_sec < soon.tv_sec || (real.tv_sec == soon.tv_sec && real.tv_nsec <= soon.tv_nsec);
  const int result = wait(is_soon ? &real : &soon);
  return result == ETIMEDOUT && !is_soon ? 0 : result;
}

// Conditions do not tell by which clock they wait: a time of day is far beyond the time since the
// start.
bool is_time_of_day(const timespec* time) {
  return time->tv_sec > 1'000'000'000;
}

}  // namespace

extern "C" {

int clock_gettime(clockid_t clock, timespec* time) noexcept {
  const int result = real_clock_gettime(clock, time);
  if (result == 0 && is_wall(clock)) time->tv_sec += shift();
  return result;
}

int gettimeofday(timeval* time, void* zone) noexcept {
  static const auto real = next<int (*)(timeval*, void*)>("gettimeofday");
  const int result = real(time, zone);
  if (result == 0) time->tv_sec += shift();
  return result;
}

time_t time(time_t* where) noexcept {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  if (where != nullptr) *where = now.tv_sec;
  return now.tv_sec;
}

int pthread_cond_timedwait(pthread_cond_t* condition, pthread_mutex_t* mutex,
                           const timespec* until) {
  static const auto real =
      next<int (*)(pthread_cond_t*, pthread_mutex_t*, const timespec*)>("pthread_cond_timedwait");
  if (!is_time_of_day(until)) return real(condition, mutex, until);
  return wait_until(until, [&](const timespec* t) { return real(condition, mutex, t); });
}

int pthread_cond_clockwait(pthread_cond_t* condition, pthread_mutex_t* mutex, clockid_t clock,
                           const timespec* until) {
  static const auto real =
      next<int (*)(pthread_cond_t*, pthread_mutex_t*, clockid_t, const timespec*)>(
          "pthread_cond_clockwait");
  if (!is_wall(clock)) return real(condition, mutex, clock, until);
  return wait_until(until, [&](const timespec* t) { return real(condition, mutex, clock, t); });
}

}  // extern "C"
