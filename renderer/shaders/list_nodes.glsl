// All faces of a pixel as a linked list, in the order in which they were drawn.
struct face {
    uint next;  // number of the next, from 1; 0: none
    float z;    // distance from the eye
    float hit;  // from there into the mesh to the structure; back faces: − that
    float base; // to where the structure is deepest
};

layout(std430, binding = 0) buffer Faces {
    uint n_faces; // asked for; only as many as there is room for are there
    uint spare[3];
    face faces[];
};
