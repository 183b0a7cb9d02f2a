# cmake --install: programs with manual page and completion (component "programs"); libraries, headers, CMake package
# and pkg-config file (component "development"); libslide.so (component "library").
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

install(TARGETS slide_run slide_check slide_convert COMPONENT programs)
install(FILES LICENSE NOTICE DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT programs)
install(FILES weights/README.md RENAME weights.md DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT programs)
install(FILES weights/slide_depth.md weights/slide_inpaint.md weights/slide_matte.md weights/slide_rim.md
  DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT programs)
if(TARGET slide_docs)
  foreach(program slide_run slide_check slide_convert)
    install(FILES ${CMAKE_BINARY_DIR}/share/${program}.1 DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT programs)
    install(FILES ${CMAKE_BINARY_DIR}/share/${program}.bash RENAME ${program} COMPONENT programs
      DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
  endforeach()
endif()

# The C API, and the C++ libraries from the top one down, which is the order that linkers want.
set(libraries slide_examples slide_render slide_weights slide_graphs slide_ops slide_runtime)
set_target_properties(slide_examples PROPERTIES OUTPUT_NAME slide_network_files)
target_include_directories(slide INTERFACE $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
set(SLIDE_PC_PRIVATE "")
foreach(library ${libraries})
  string(REPLACE slide_ "" name ${library})
  set_target_properties(${library} PROPERTIES EXPORT_NAME ${name})
  target_include_directories(${library} INTERFACE $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}/slide>)
  target_compile_features(${library} INTERFACE $<INSTALL_INTERFACE:cxx_std_20>)
  string(APPEND SLIDE_PC_PRIVATE "-l$<TARGET_FILE_BASE_NAME:${library}> ")
endforeach()
install(TARGETS slide ${libraries} EXPORT slideTargets ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development)
if(SLIDE_SHARED)
  target_include_directories(slide_shared INTERFACE $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  set_target_properties(slide_shared PROPERTIES EXPORT_NAME shared)
  install(TARGETS slide_shared EXPORT slideTargets
    LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT library NAMELINK_COMPONENT development)
endif()
install(FILES examples/c_api/slide.h examples/c_api/slide_operator.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/slide COMPONENT development)
# Left out: what only the libraries' own sources include.
install(DIRECTORY runtime ops graphs render DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/slide COMPONENT development
  FILES_MATCHING PATTERN "*.h" PATTERN "ops/simd" EXCLUDE PATTERN "render/viewer" EXCLUDE
  PATTERN "case_attributes.h" EXCLUDE PATTERN "cone_kernel.h" EXCLUDE)
install(FILES weights/default_weights.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/slide/weights COMPONENT development)

set(package_folder ${CMAKE_INSTALL_LIBDIR}/cmake/slide)
install(EXPORT slideTargets NAMESPACE slide:: DESTINATION ${package_folder} COMPONENT development)
configure_package_config_file(cmake/slideConfig.cmake.in ${CMAKE_BINARY_DIR}/package/slideConfig.cmake
  INSTALL_DESTINATION ${package_folder})
write_basic_package_version_file(${CMAKE_BINARY_DIR}/package/slideConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_BINARY_DIR}/package/slideConfig.cmake ${CMAKE_BINARY_DIR}/package/slideConfigVersion.cmake
  cmake/FindSlideOpenImageIO.cmake DESTINATION ${package_folder} COMPONENT development)

if(SLIDE_OPENIMAGEIO)
  string(APPEND SLIDE_PC_PRIVATE "-lOpenImageIO -lOpenImageIO_Util ")
endif()
string(APPEND SLIDE_PC_PRIVATE "-ljpeg -lpng -lz")
set(own_runtime ${OpenMP_CXX_LIB_NAMES} ${CMAKE_CXX_IMPLICIT_LINK_LIBRARIES})
foreach(name gomp omp stdc++ c++ pthread m)
  if(name IN_LIST own_runtime)
    string(APPEND SLIDE_PC_PRIVATE " -l${name}")
  endif()
endforeach()
file(RELATIVE_PATH SLIDE_PC_UP /prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig /prefix)
string(REGEX REPLACE "/$" "" SLIDE_PC_UP ${SLIDE_PC_UP})
configure_file(cmake/slide.pc.in ${CMAKE_BINARY_DIR}/package/slide.pc.in @ONLY)
file(GENERATE OUTPUT ${CMAKE_BINARY_DIR}/package/slide.pc INPUT ${CMAKE_BINARY_DIR}/package/slide.pc.in)
install(FILES ${CMAKE_BINARY_DIR}/package/slide.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT development)

# cpack -G DEB in the build folder: slide_VERSION_ARCH.deb with the programs, slide-dev with the libraries,
# libslide0.2 with the shared one.
set(CPACK_PACKAGE_NAME slide)
set(CPACK_PACKAGE_CONTACT "The SLIDE project")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "Turns single photographs into 3D photos, on a CPU")
set(CPACK_GENERATOR DEB)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_ENABLE_COMPONENT_DEPENDS OFF)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PROGRAMS_PACKAGE_NAME slide)
set(CPACK_DEBIAN_PROGRAMS_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME slide-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_LIBRARY_PACKAGE_NAME libslide${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
set(CPACK_DEBIAN_LIBRARY_PACKAGE_SECTION libs)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
include(CPack)
