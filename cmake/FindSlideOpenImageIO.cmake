# Finds OpenImageIO and makes the target SlideOpenImageIO::SlideOpenImageIO. Not through OpenImageIO's own CMake
# package: Debian's insists on programs and Python modules of other packages.
include(FindPackageHandleStandardArgs)
find_path(OPENIMAGEIO_INCLUDE_DIR OpenImageIO/imageio.h)
find_library(OPENIMAGEIO_LIBRARY OpenImageIO)
find_library(OPENIMAGEIO_UTIL_LIBRARY OpenImageIO_Util)
find_package_handle_standard_args(SlideOpenImageIO
  REQUIRED_VARS OPENIMAGEIO_LIBRARY OPENIMAGEIO_UTIL_LIBRARY OPENIMAGEIO_INCLUDE_DIR)
mark_as_advanced(OPENIMAGEIO_INCLUDE_DIR OPENIMAGEIO_LIBRARY OPENIMAGEIO_UTIL_LIBRARY)
if(SlideOpenImageIO_FOUND AND NOT TARGET SlideOpenImageIO::SlideOpenImageIO)
  add_library(SlideOpenImageIO::SlideOpenImageIO UNKNOWN IMPORTED)
  set_target_properties(SlideOpenImageIO::SlideOpenImageIO PROPERTIES
    IMPORTED_LOCATION "${OPENIMAGEIO_LIBRARY}"
    INTERFACE_INCLUDE_DIRECTORIES "${OPENIMAGEIO_INCLUDE_DIR}"
    INTERFACE_LINK_LIBRARIES "${OPENIMAGEIO_UTIL_LIBRARY}")
endif()
