pub struct Threshold;
