// All faces of a pixel as a linked list, in the order in which they were drawn.
struct face {
    uint next;  // number of the next face, from 1; 0: none
    float z;    // distance from the eye
    float hit;  // distance from z into the mesh to the structure; back faces: negative
    float base; // distance from z to where the ray is as deep as the deepest structure
};

layout(std430, binding = 0) buffer Faces {
    uint n_faces; // asked for; only as many as there is room for are there
    uint spare[3];
    face faces[];
};
