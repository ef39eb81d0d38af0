"""What network can predict simulated hair: a study of deformers with full supervision in 3D."""
