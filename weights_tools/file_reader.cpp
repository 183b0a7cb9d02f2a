#include "weights_tools/file_reader.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <system_error>

#include "runtime/error.h"
#include "weights_tools/sha256.h"

namespace slide {
namespace {

constexpr std::size_t kPiece = std::size_t{256} << 10;

Error failed(const std::string& path, int code) {
  return Error(ErrorKind::kBadWeights, "cannot read " + path + ": " + std::generic_category().message(code));
}

}  // namespace

FileReader::FileReader(const std::string& path)
    : path_(path), descriptor_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)) {
  if (descriptor_ < 0) throw failed(path, errno);
  struct stat status {};
  const int code = ::fstat(descriptor_, &status) != 0 ? errno : 0;
  if (code == 0 && S_ISREG(status.st_mode)) {
    size_ = static_cast<std::uint64_t>(status.st_size);
    return;
  }
  ::close(descriptor_);
  if (code != 0) throw failed(path, code);
  throw Error(ErrorKind::kBadWeights, "cannot read " + path + ": it is not a regular file");
}

FileReader::~FileReader() { ::close(descriptor_); }

void FileReader::require(std::uint64_t offset, std::uint64_t count) const {
  if (offset <= size_ && count <= size_ - offset) return;
  throw Error(ErrorKind::kBadWeights, path_ + ": the file is cut short: " + std::to_string(count) +
                                          " bytes are needed at byte " + std::to_string(offset) +
                                          ", the file ends at byte " + std::to_string(size_));
}

void FileReader::read(std::uint64_t offset, std::span<std::byte> out) const {
  require(offset, out.size());
  while (!out.empty()) {
    const ssize_t n = ::pread(descriptor_, out.data(), out.size(), static_cast<off_t>(offset));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw failed(path_, errno);
    if (n == 0)
      throw Error(ErrorKind::kBadWeights, path_ + ": the file became shorter while it was read (byte " +
                                              std::to_string(offset) + ")");
    out = out.subspan(static_cast<std::size_t>(n));
    offset += static_cast<std::uint64_t>(n);
  }
}

std::vector<std::byte> FileReader::read(std::uint64_t offset, std::size_t count) const {
  require(offset, count);  // before anything is allocated
  std::vector<std::byte> bytes(count);
  read(offset, bytes);
  return bytes;
}

void FileReader::for_each_piece(std::uint64_t offset, std::uint64_t count,
                                const std::function<void(std::span<const std::byte>)>& take) const {
  std::vector<std::byte> buffer(static_cast<std::size_t>(std::min<std::uint64_t>(kPiece, count)));
  while (count > 0) {
    const std::span<std::byte> piece =
        std::span(buffer).first(static_cast<std::size_t>(std::min<std::uint64_t>(buffer.size(), count)));
    read(offset, piece);
    take(piece);
    offset += piece.size();
    count -= piece.size();
  }
}

std::string sha256_of(const FileReader& file) {
  Sha256 sha;
  file.for_each_piece(0, file.size(), [&](std::span<const std::byte> piece) { sha.update(piece); });
  return sha.finish();
}

}  // namespace slide
