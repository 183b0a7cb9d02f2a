#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "render/base64.h"
#include "render/codec.h"

/// JPEG files with a depth map inside, as phones write them.
namespace phone {

using Bytes = std::vector<std::uint8_t>;

inline const std::string kGuid = "0123456789ABCDEF0123456789ABCDEF";

inline void append(Bytes& bytes, const Bytes& more) { bytes.insert(bytes.end(), more.begin(), more.end()); }

inline Bytes bytes_of(const std::string& text) { return {text.begin(), text.end()}; }

/// The file with an APP1 segment behind its start marker.
inline Bytes with_segment(const Bytes& jpeg, const Bytes& payload) {
  const std::size_t length = payload.size() + 2;
  Bytes out(jpeg.size() + payload.size() + 4);
  out[0] = 0xFF;
  out[1] = 0xD8;
  out[2] = 0xFF;
  out[3] = 0xE1;
  out[4] = static_cast<std::uint8_t>(length >> 8U);
  out[5] = static_cast<std::uint8_t>(length & 0xFFU);
  std::copy(payload.begin(), payload.end(), out.begin() + 6);
  std::copy(jpeg.begin() + 2, jpeg.end(), out.begin() + 6 + static_cast<std::ptrdiff_t>(payload.size()));
  return out;
}

inline std::string packet(const std::string& inside) {
  return "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF>" + inside + "</rdf:RDF></x:xmpmeta>";
}

inline Bytes with_xmp(const Bytes& jpeg, const std::string& inside) {
  Bytes payload = bytes_of("http://ns.adobe.com/xap/1.0/");
  payload.push_back(0);
  append(payload, bytes_of(packet(inside)));
  return with_segment(jpeg, payload);
}

/// A part of an extended packet, `offset` bytes into its `whole`.
inline Bytes extension_part(const std::string& whole, std::size_t offset, std::size_t length) {
  Bytes payload = bytes_of("http://ns.adobe.com/xmp/extension/");
  payload.push_back(0);
  append(payload, bytes_of(kGuid));
  for (const std::size_t number : {whole.size(), offset})
    for (unsigned shift = 32; shift > 0; shift -= 8)
      payload.push_back(static_cast<std::uint8_t>(number >> (shift - 8) & 0xFFU));
  append(payload, bytes_of(whole.substr(offset, length)));
  return payload;
}

/// GDepth in one packet. `about`: Format, Near, Far.
inline Bytes gdepth(const Bytes& jpeg, const Bytes& map, const std::string& about) {
  return with_xmp(jpeg, "<rdf:Description " + about + " GDepth:Data=\"" + slide::base64(map) + "\"/>");
}

/// Dynamic Depth: the photo, `between` (a gain map, say), and the map.
inline Bytes dynamic_depth(const Bytes& jpeg, const Bytes& between, const Bytes& map,
                           const std::string& about) {
  const auto item = [](const std::string& uri, std::size_t length) {
    return "<rdf:li rdf:parseType=\"Resource\"><Container:Item Item:Mime=\"image/jpeg\" Item:Length=\"" +
           std::to_string(length) + "\" Item:DataURI=\"" + uri + "\"/></rdf:li>";
  };
  Bytes out =
      with_xmp(jpeg, "<rdf:Description><Container:Directory><rdf:Seq>" + item("primary_image", 0) +
                         item("android/gainmap", between.size()) + item("android/depthmap", map.size()) +
                         "</rdf:Seq></Container:Directory><Camera:DepthMap " + about +
                         " DepthMap:DepthURI=\"android/depthmap\"/></rdf:Description>");
  append(out, between);
  append(out, map);
  return out;
}

}  // namespace phone
