#include "weights_tools/sha256.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <span>
#include <string>

using namespace slide;

namespace {

std::string sha(const std::string& text) {
  Sha256 hash;
  hash.update(std::as_bytes(std::span(text)));
  return hash.finish();
}

}  // namespace

TEST_CASE("SHA-256 gives the values that NIST publishes") {
  CHECK(sha("") == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  CHECK(sha("abc") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  CHECK(sha("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq") ==
        "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  CHECK(sha(std::string(1'000'000, 'a')) ==
        "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

TEST_CASE("SHA-256 pads every length rightly, in whatever pieces the text comes") {
  // The digest of all digests of 0 to 199 bytes 0, 1, 2, ..., by Python's hashlib.
  std::string all;
  for (std::size_t length = 0; length < 200; ++length) {
    std::string text;
    for (std::size_t i = 0; i < length; ++i) text += static_cast<char>(i);
    Sha256 pieces;
    for (std::size_t i = 0; i < length; i += 1 + length / 3)
      pieces.update(std::as_bytes(std::span(text)).subspan(i, std::min(1 + length / 3, length - i)));
    all += sha(text);
    REQUIRE(pieces.finish() == sha(text));
  }
  CHECK(sha(all) == "7a38a844c9e159de39f0862ee2e28569a8250831150a3fbf0a59c001129b2fb2");
}
