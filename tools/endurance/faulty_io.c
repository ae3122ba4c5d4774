/* Bad luck for a process, by LD_PRELOAD: a network that loses and delays, a disk that is slow or full.
 *
 * FAULTY_UDP_LOSS       share of the packets that are lost on their way out
 * FAULTY_UDP_DELAY_MS   that every packet takes longer
 * FAULTY_DISK           folder of the disk; writes to files below it are
 * FAULTY_DISK_DELAY_MS  late by so much each, and
 * FAULTY_DISK_ROOM      refused, as by a full disk, once so many bytes are written
 *
 * cc -shared -fPIC -o faulty_io.so faulty_io.c -ldl
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

static __thread unsigned long long drawn = 0;
static _Atomic long long written = 0;

static double number(const char *name, double otherwise)
{
  const char *text = getenv(name);
  return text ? atof(text) : otherwise;
}

static void wait_ms(double ms)
{
  struct timespec left = {(time_t)(ms / 1e3), (long)(ms * 1e6) % 1000000000L};
  if (ms > 0.0) nanosleep(&left, NULL);
}

static int is_lost(void)
{
  double share = number("FAULTY_UDP_LOSS", 0.0);
  if (!drawn) drawn = (unsigned long long)(size_t)&drawn ^ ((unsigned long long)getpid() << 32);
  drawn = drawn * 6364136223846793005ULL + 1442695040888963407ULL;
  return (drawn >> 11) * 0x1p-53 < share;
}

static int is_udp(int socket_fd)
{
  int type = 0;
  socklen_t size = sizeof type;
  return getsockopt(socket_fd, SOL_SOCKET, SO_TYPE, &type, &size) == 0 && type == SOCK_DGRAM;
}

ssize_t sendmsg(int fd, const struct msghdr *message, int flags)
{
  static ssize_t (*real)(int, const struct msghdr *, int);
  if (!real) real = dlsym(RTLD_NEXT, "sendmsg");
  if (is_udp(fd)) {
    wait_ms(number("FAULTY_UDP_DELAY_MS", 0.0));
    if (is_lost()) {
      ssize_t total = 0;
      for (size_t i = 0; i < message->msg_iovlen; i++) total += message->msg_iov[i].iov_len;
      return total;
    }
  }
  return real(fd, message, flags);
}

ssize_t sendto(int fd, const void *content, size_t size, int flags, const struct sockaddr *to,
               socklen_t to_size)
{
  static ssize_t (*real)(int, const void *, size_t, int, const struct sockaddr *, socklen_t);
  if (!real) real = dlsym(RTLD_NEXT, "sendto");
  if (is_udp(fd)) {
    wait_ms(number("FAULTY_UDP_DELAY_MS", 0.0));
    if (is_lost()) return size;
  }
  return real(fd, content, size, flags, to, to_size);
}

static int is_on_disk(int fd)
{
  const char *folder = getenv("FAULTY_DISK");
  char link[64], path[PATH_MAX];
  struct stat about;
  if (!folder || fstat(fd, &about) != 0 || !S_ISREG(about.st_mode)) return 0;
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  ssize_t size = readlink(link, path, sizeof path - 1);
  if (size < 0) return 0;
  path[size] = '\0';
  return strncmp(path, folder, strlen(folder)) == 0;
}

ssize_t write(int fd, const void *content, size_t size)
{
  static ssize_t (*real)(int, const void *, size_t);
  if (!real) real = dlsym(RTLD_NEXT, "write");
  if (is_on_disk(fd)) {
    wait_ms(number("FAULTY_DISK_DELAY_MS", 0.0));
    if (written + (long long)size > number("FAULTY_DISK_ROOM", 1e18)) {
      errno = ENOSPC;
      return -1;
    }
    written += size;
  }
  return real(fd, content, size);
}
