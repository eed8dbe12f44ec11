# A room: a folder, a static library room_NAME of its sources, and an include path under its name
# (#include "NAME/header.h"). It may include headers of the rooms in USES only.
# ARCHITECTURE.md has the table of what each may use. The test "rooms" compares the code with it.
#
#   mesorig_room(FOLDER [FOLDERS sub-folder…] [USES room…] [LIBRARIES library…] [WITHOUT source…])
#
# “FOLDERS *” stands for all sub-folders.
function(mesorig_room folder)
  cmake_parse_arguments(PARSE_ARGV 1 ROOM "" "" "FOLDERS;USES;LIBRARIES;WITHOUT")
  get_filename_component(name ${folder} NAME)
  set(path ${CMAKE_CURRENT_SOURCE_DIR}/${folder})
  set(sources)
  foreach(part . ${ROOM_FOLDERS})
    file(GLOB found CONFIGURE_DEPENDS ${path}/${part}/*.c ${path}/${part}/*.cpp)
    list(APPEND sources ${found})
  endforeach()
  list(TRANSFORM sources REPLACE "/\\./" "/")
  list(TRANSFORM ROOM_WITHOUT PREPEND ${path}/)
  list(REMOVE_ITEM sources ${ROOM_WITHOUT})
  set(includes ${PROJECT_BINARY_DIR}/rooms/${name})
  file(MAKE_DIRECTORY ${includes})
  file(CREATE_LINK ${path} ${includes}/${name} SYMBOLIC)
  list(TRANSFORM ROOM_USES PREPEND room_)
  add_library(room_${name} STATIC ${sources})
  set_property(GLOBAL APPEND PROPERTY MESORIG_ROOMS room_${name})
  if(name IN_LIST MESORIG_COVERAGE) # not optimised: branches are those of the source
    target_compile_options(room_${name} PRIVATE --coverage -O0 -fprofile-update=atomic)
    target_link_options(room_${name} PUBLIC --coverage)
  endif()
  target_include_directories(room_${name} PUBLIC ${includes})
  target_link_libraries(room_${name} PUBLIC PkgConfig::GLIB ${ROOM_USES}
                        PRIVATE ${ROOM_LIBRARIES} Threads::Threads m)
endfunction()
