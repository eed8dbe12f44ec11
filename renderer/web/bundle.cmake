# Writes OUTPUT/shaders.js, the viewer's shaders of OpenGL 3.3 as texts for OpenGL ES 3.00, and
# OUTPUT/page.html, the page with style, program and shaders in it; and the npm package in PACKAGE.
# WEB and SHADERS are the folders of the sources.
set(names mesh.vert screen.vert frame.glsl places.glsl levels.glsl lpca_texel.glsl lpca_revised.glsl neural.glsl
    further.glsl lamps.glsl surface.frag shadow.glsl visible.glsl surface_relief.frag directions.glsl
    sight.glsl curved.glsl along.glsl meets.glsl relief.glsl shell.glsl peel_back.frag peel_front.frag shadow_map.frag background.frag tone.glsl resolve.frag)
# The order is that of who imports whom.
set(modules vectors.js material_file.js gpu.js local_pca.js neural_planes.js shapes.js camera.js relief.js viewer.js page.js)

# ES 3.00 differs in the first line and in default precisions, which gpu.js puts before each text. What
# else it lacks is refused here rather than in a browser.
set(js "// Made of renderer/shaders by bundle.cmake.\nexport const shaders = {\n")
foreach(name ${names})
  file(READ ${SHADERS}/${name} text)
  if(text MATCHES "[`$\\\\]")
    message(FATAL_ERROR "${name}: a character that a template of JavaScript cannot hold")
  endif()
  if(text MATCHES "samplerBuffer|sampler1D|noperspective|dFdxFine|textureQuery|double |gl_ClipDistance|std430")
    message(FATAL_ERROR "${name}: “${CMAKE_MATCH_0}” is not in OpenGL ES 3.00")
  endif()
  string(REGEX REPLACE "(^|\n)//[^\n]*" "\\1" text "${text}")
  string(REGEX REPLACE "\n\n+" "\n" text "${text}")
  string(APPEND js "\"${name}\": `${text}`,\n")
endforeach()
string(APPEND js "};\n")
file(WRITE ${OUTPUT}/shaders.js "${js}")

# One script: modules cannot import each other in a page that is opened from a disk.
string(REPLACE "export const" "const" script "${js}")
foreach(module ${modules})
  file(READ ${WEB}/${module} text)
  string(REGEX REPLACE "(^|\n)import [^\n]*" "\\1" text "${text}")
  string(REGEX REPLACE "(^|\n)export " "\\1" text "${text}")
  string(APPEND script "\n// ${module}\n${text}")
endforeach()
if(script MATCHES "</script|<!--")
  message(FATAL_ERROR "the page's program holds “${CMAKE_MATCH_0}”, which would end it")
endif()
file(READ ${WEB}/page.html page)
file(READ ${WEB}/page.css style)
string(REPLACE "/*STYLE*/" "${style}" page "${page}")
string(REPLACE "/*SCRIPT*/" "${script}" page "${page}")
file(WRITE ${OUTPUT}/page.html "${page}")

list(REMOVE_ITEM modules page.js)
file(MAKE_DIRECTORY ${PACKAGE})
foreach(file ${modules} mesorig_material.js example.html README.md package.json)
  file(COPY ${WEB}/${file} DESTINATION ${PACKAGE})
endforeach()
file(COPY ${OUTPUT}/shaders.js ${WEB}/../../LICENSE DESTINATION ${PACKAGE})
file(TOUCH ${PACKAGE}/package.json)
