// The faces of each pixel, as a linked list that begins with the face that was drawn last.
struct face {
    uint next; // number of the next face, from 1; 0 if there is none
    float z;   // distance from the eye
    float hit; // distance from the face along the ray to the structure; negative for back faces
    // distance from the face to the point where the ray is as deep as the deepest structure
    float base;
};

layout(std430, binding = 0) buffer Faces {
    uint n_faces; // number of faces that were drawn; only those that fit are stored
    uint spare[3];
    face faces[];
};
