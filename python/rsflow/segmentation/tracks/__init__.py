"""How things that move are followed: what a mask shows of them, whose it is, and where they are going."""
