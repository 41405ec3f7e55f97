# What `cmake --install` puts in place: archives, headers, the package onebit for CMake's find_package,
# and onebit.pc, onebit-f64.pc, onebit-f32.pc, onebit-q31.pc for pkg-config. Nothing in them names
# the place, so that the installed tree can be moved. Needs `arithmetics` of CMakeLists.txt.
include(CMakePackageConfigHelpers)
include(GNUInstallDirs)

list(TRANSFORM arithmetics PREPEND onebit_ OUTPUT_VARIABLE libraries)
install(TARGETS onebit_base ${libraries}
    EXPORT onebit
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}
    INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/onebit)
# The public ones; what the library is made with stays here.
set(headers onebit.h onebit_frame.h onebit_limits.h onebit_random.h onebit_status.h onebit_types.h
    onebit_version.h)
install(FILES ${headers} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/onebit)

# The package needs no other, so the exported targets are the whole of it. Before 1.0.0 a new minor
# version may change what there is.
set(package ${CMAKE_INSTALL_LIBDIR}/cmake/onebit)
write_basic_package_version_file(onebit-config-version.cmake COMPATIBILITY SameMinorVersion)
install(EXPORT onebit NAMESPACE onebit:: FILE onebit-config.cmake DESTINATION ${package})
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/onebit-config-version.cmake DESTINATION ${package})

# From where the .pc files lie back to the prefix; absolute folders stand as they are.
cmake_path(ABSOLUTE_PATH CMAKE_INSTALL_LIBDIR BASE_DIRECTORY ${CMAKE_INSTALL_PREFIX}
    OUTPUT_VARIABLE pc_folder)
cmake_path(APPEND pc_folder pkgconfig)
set(pc_prefix ${CMAKE_INSTALL_PREFIX})
if(NOT IS_ABSOLUTE ${CMAKE_INSTALL_LIBDIR})
    cmake_path(RELATIVE_PATH pc_prefix BASE_DIRECTORY ${pc_folder})
    set(pc_prefix "\${pcfiledir}/${pc_prefix}")
endif()
set(pc_lib "\${prefix}")
cmake_path(APPEND pc_lib ${CMAKE_INSTALL_LIBDIR})
set(pc_include "\${prefix}")
cmake_path(APPEND pc_include ${CMAKE_INSTALL_INCLUDEDIR} onebit)

# onebit.pc is q31 by its full name.
foreach(arithmetic IN LISTS arithmetics)
    string(TOUPPER ${arithmetic} name)
    set(pc_libraries "-lonebit_${arithmetic} -lonebit_base")
    if(arithmetic STREQUAL f64)
        string(APPEND pc_libraries " -lm")
    endif()
    configure_file(onebit-arithmetic.pc.in onebit-${arithmetic}.pc @ONLY)
    list(APPEND pc_files ${CMAKE_CURRENT_BINARY_DIR}/onebit-${arithmetic}.pc)
endforeach()
configure_file(onebit.pc.in onebit.pc @ONLY)
install(FILES ${pc_files} ${CMAKE_CURRENT_BINARY_DIR}/onebit.pc
    DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
